// The recording reader against arbitrary bytes: verifying, replaying, seeking, attachments, recovering; and the decoder
// of each message by itself, which chunks with a CRC keep a fuzzer away from.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

#include "acquisition/recording.h"
#include "acquisition/recording_messages.h"
#include "core/check.h"

namespace gnathion {
namespace {

/// A file in memory that has a path.
class MemoryFile {
 public:
  explicit MemoryFile(const char* name) : fd_(::memfd_create(name, 0)) {
    GNATHION_CHECK(fd_ >= 0);
    path_ = "/proc/self/fd/" + std::to_string(fd_);
  }
  const std::string& path() const { return path_; }
  void fill(const std::uint8_t* data, std::size_t size) const {
    GNATHION_CHECK(::ftruncate(fd_, 0) == 0);
    GNATHION_CHECK(::pwrite(fd_, data, size, 0) == static_cast<ssize_t>(size));
  }

 private:
  int fd_;
  std::string path_;
};

void read_to_the_end(RecordingSource& source) {
  while (true) {
    const auto next = source.next();
    if (!next || !*next) return;
  }
}

void replay(const std::string& path) {
  auto source = RecordingSource::open(path);
  if (!source) return;
  read_to_the_end(**source);
  const auto range = (*source)->time_range();
  for (const std::int64_t from :
       {std::int64_t{0}, range ? range->first.ns / 2 + range->second.ns / 2 : 1'000'000, INT64_MIN}) {
    if (!(*source)->seek({from})) return;
    read_to_the_end(**source);
  }
  for (const AttachmentInfo& a : (*source)->attachments()) (void)(*source)->attachment(a.name);
}

void decode_alone(std::string_view bytes) {
  const SampleHeader header{"fuzz", 1, {2}, {3}, {4}};
  (void)decode_image(header, bytes, "fuzz");
  (void)decode_event(header, bytes, "fuzz");
  (void)decode_ledger(bytes, "fuzz");
  (void)decode_scan(header, bytes, "fuzz");
  if (const auto pose = decode_pose_state(header, bytes, "fuzz")) {
    const auto again = decode_pose_state(header, encode_pose_state(*pose), "fuzz");
    GNATHION_CHECK(again && again->body == pose->body && again->reason == pose->reason);
  }
  if (const auto transfer = decode_transfer(header, bytes, "fuzz")) {
    const auto again = decode_transfer(header, encode_transfer(*transfer), "fuzz");
    GNATHION_CHECK(again && again->data == transfer->data && again->status == transfer->status);
  }
}

}  // namespace
}  // namespace gnathion

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace gnathion;
  static const MemoryFile given("given"), saved("saved");
  decode_alone({reinterpret_cast<const char*>(data), size});
  given.fill(data, size);
  (void)summarise_recording(given.path());
  replay(given.path());
  // Whatever was damaged, what recovery writes is sound.
  if (recover_recording(given.path(), saved.path())) {
    const auto summary = summarise_recording(saved.path());
    GNATHION_CHECK(summary.has_value() ? summary->whole : summary.error().code == ErrorCode::kInput);
    replay(saved.path());
  }
  return 0;
}
