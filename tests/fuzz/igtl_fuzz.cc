// The OpenIGTLink decoder against arbitrary bytes: any answer but a crash, a hang or a lie. The first byte
// chooses the way in, because a checksum in front of everything would keep the fuzzer out:
//   even  the rest is a byte stream, as a socket gives it;
//   odd   the rest is cut into bodies, each packed with a right checksum.
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "acquisition/igtl/igtl_translator.h"

namespace {

using namespace gnathion;

void require(bool condition, const char* promise) {
  if (condition) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

constexpr std::array<const char*, 7> kTypes = {"TRANSFORM", "TDATA",  "QTDATA", "IMAGE",
                                               "POLYDATA",  "STATUS", "STRING"};

/// Bodies as (type, version, length, bytes), packed as a peer would.
std::string packed(const std::uint8_t* data, std::size_t size) {
  std::string stream;
  while (size >= 4) {
    const std::size_t length = std::min<std::size_t>(size - 4, data[2] | data[3] << 8);
    std::string message =
        igtl::pack(kTypes[data[0] % kTypes.size()], data[0] & 0x80 ? "b" : "AToB",
                   {reinterpret_cast<const char*>(data) + 4, length}, std::uint64_t{data[1]} << 31);
    message[1] = static_cast<char>(1 + data[1] % 2);
    stream += message;
    data += 4 + length;
    size -= 4 + length;
  }
  return stream;
}

std::vector<igtl::Item> items_of(const std::string& stream, std::size_t step) {
  igtl::Framer framer(1 << 16);
  std::vector<igtl::Item> items;
  const auto drain = [&] {
    while (auto item = framer.next()) items.push_back(std::move(*item));
  };
  for (std::size_t at = 0; at < stream.size(); at += step) {
    framer.feed(std::string_view(stream).substr(at, step));
    drain();
    require(framer.waiting_bytes() <= (1 << 16) + igtl::kHeaderBytes + step, "one message waits at most");
  }
  framer.finish();
  drain();
  require(framer.waiting_bytes() == 0, "at the end nothing waits");
  return items;
}

void check_sample(const Sample& sample) {
  const SampleHeader& h = header_of(sample);
  require(h.stream.substr(0, 1) == "f", "streams begin with the device's name");
  for (const char c : h.stream)
    require(std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-' || c == '/',
            "a stream's name is one");
  if (const auto* pose = std::get_if<PoseSample>(&sample)) {
    require(pose->valid == pose->reason.empty(), "a pose that is not valid says why");
    require(rigidity_deviation(pose->reference_from_body.matrix()).is_rigid(1e-9), "a pose is rigid");
  } else if (const auto* frame = std::get_if<FrameSample>(&sample)) {
    require(frame->image.width_px > 0 &&
                frame->image.pixels.size() == static_cast<std::size_t>(frame->image.width_px) *
                                                  static_cast<std::size_t>(frame->image.height_px),
            "an image has its pixels");
  } else if (const auto* scan = std::get_if<ScanSample>(&sample)) {
    require(scan->files.size() == 1 && scan->files.count(scan->name) == 1, "a scan has its file");
  } else if (const auto* line = std::get_if<LedgerSample>(&sample)) {
    require(line->count > 0 && !line->reason.empty(), "a ledger line counts and says why");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const bool raw = data[0] % 2 == 0;
  const std::string stream =
      raw ? std::string(reinterpret_cast<const char*>(data) + 1, size - 1) : packed(data + 1, size - 1);
  const std::vector<igtl::Item> items = items_of(stream, stream.size() + 1);
  const std::vector<igtl::Item> again = items_of(stream, 1 + data[0] / 2);
  std::vector<std::string> bodies, bodies_again;
  for (const auto& item : items)
    if (item.kind == igtl::Item::Kind::kMessage) bodies.push_back(item.body);
  for (const auto& item : again)
    if (item.kind == igtl::Item::Kind::kMessage) bodies_again.push_back(item.body);
  require(bodies == bodies_again, "how the bytes are cut does not matter");

  igtl::Translator::Options options;
  options.name = "f";
  options.max_streams = 8;
  options.message_ids = static_cast<igtl::MessageIds>(size % 3);
  options.decoding.normalise_quaternions = size % 2 == 0;
  igtl::Translator translator(options);
  std::int64_t arrival_ns = 1'700'000'000'000'000'000;
  for (const auto& item : items)
    for (const Sample& sample : translator.take(item, {arrival_ns += 1'000'000})) check_sample(sample);
  return 0;
}
