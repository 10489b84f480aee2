// Replay takes at most 64 MiB however long the file: a recording of some 200 MB with a large attachment is
// replayed by a process of its own, whose peak memory is compared with what it had before it opened the file.
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>

#include "acquisition/recording.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr std::uint32_t kFrames = 220;
constexpr double kLargest_mib = 64;

Status write_long_recording(const fs::path& path) {
  RecordingOptions options;
  options.compression = "";  // its size is what matters here
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path, options));
  GNATHION_CHECK_OK(
      writer.attach("scan.ply", "application/octet-stream", std::string(std::size_t{80} << 20, 'x')));
  FrameSample frame{{"camera_0", 0, {0}, {0}, {0}}, camera_like_image(1280, 720, 5)};
  const SyntheticDevice::Maker tracker = tracker_maker();
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    frame.header.sequence = i;
    frame.header.arrival.ns += 16'666'667;
    GNATHION_CHECK_OK(writer.write(frame));
    for (std::uint32_t k = 0; k < 100; ++k)
      GNATHION_CHECK_OK(writer.write(tracker({"tracker", 100 * i + k, {0}, frame.header.arrival, {0}})));
  }
  return writer.finish();
}

/// Counts the frames from `from` on; the tracker's samples come with them.
Result<std::uint32_t> replay(RecordingSource& source, HostTime from) {
  GNATHION_CHECK_OK(source.seek(from));
  std::uint32_t frames = 0;
  while (true) {
    GNATHION_TRY(const auto sample, source.next());
    if (!sample) return frames;
    frames += std::holds_alternative<FrameSample>(*sample);
  }
}

int measure(const fs::path& path) {
  const double before_mib = peak_rss_mib();
  auto source = RecordingSource::open(path);
  if (!source) return 1;
  const auto all = replay(**source, {0});
  const auto half = replay(**source, {kFrames / 2 * 16'666'667LL + 1});
  const double taken_mib = peak_rss_mib() - before_mib;
  fmt::print("{} MB, {} frames, from the middle {}: {:.1f} MiB\n", fs::file_size(path) / 1'000'000, *all,
             *half, taken_mib);
  return *all == kFrames && *half == kFrames / 2 && taken_mib <= kLargest_mib ? 0 : 1;
}

int run(const char* self) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  std::puts("SKIPPED: a sanitizer's own memory hides what replay takes");
  (void)self;
  return 77;
#else
  const fs::path path = fs::temp_directory_path() / fmt::format("gnathion_replay_memory_{}.mcap", ::getpid());
  int how = 1 << 8;
  if (const Status written = write_long_recording(path); !written) {
    std::puts(written.error().line().c_str());
  } else if (const pid_t child = ::fork(); child == 0) {
    ::execl("/proc/self/exe", self, path.c_str(), nullptr);
    ::_exit(127);
  } else {
    ::waitpid(child, &how, 0);
  }
  fs::remove(path);
  return WIFEXITED(how) ? WEXITSTATUS(how) : 1;
#endif
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  return argc > 1 ? gnathion::measure(argv[1]) : gnathion::run(argv[0]);
}
