// Writes recordings of every kind and origin into a folder, for the official reader to judge.
// Usage: recording_samples FOLDER, or recording_samples --seeds FOLDER for the fuzzer's
// (tests/fuzz/corpus/recording).
#include <cstdio>
#include <filesystem>

#include "acquisition/mcap_format.h"
#include "acquisition/session.h"
#include "core/file.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

/// Three seconds of two cameras, a tracker, a pedal with its raw transfers, and scans.
Status write_session(const fs::path& path, const RecordingOptions& options) {
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path, options));
  GNATHION_CHECK_OK(writer.attach("rig.toml", "text/plain", "bow = \"bow.toml\"\n"));
  const SyntheticDevice::Maker camera =
      camera_maker({camera_like_image(320, 180, 1), camera_like_image(320, 180, 2)});
  const SyntheticDevice::Maker tracker = tracker_maker(), pedal = pedal_maker(), raw = transfer_maker();
  const auto header = [](const char* stream, std::uint32_t sequence, std::int64_t ns) {
    const std::int64_t epoch_ns = 1'760'000'000'000'000'000;
    return SampleHeader{stream, sequence, {epoch_ns + ns - 5'000'000}, {epoch_ns + ns}, {ns}};
  };
  for (std::uint32_t i = 0; i < 720; ++i) {
    const std::int64_t now_ns = std::int64_t{i} * 1'000'000'000 / 240;
    GNATHION_CHECK_OK(writer.write(tracker(header("tracker", i, now_ns))));
    if (i % 4 == 0 && i % 100 != 96) {  // some frames are missing
      GNATHION_CHECK_OK(writer.write(camera(header("camera_0", i / 4, now_ns + 1000))));
      GNATHION_CHECK_OK(writer.write(camera(header("camera_1", i / 4, now_ns + 2000))));
    }
    if (i % 60 == 0) {
      GNATHION_CHECK_OK(writer.write(raw(header("pedal/raw", i / 60, now_ns + 3000))));
      GNATHION_CHECK_OK(writer.write(pedal(header("pedal", i / 60, now_ns + 3001))));
    }
    if (i == 300) {
      PoseSample lost{header("tracker", 300, now_ns), "transmitter", "sensor_2", false, "distorted", {}};
      GNATHION_CHECK_OK(writer.write(lost));
      ScanSample scan{header("face", 0, now_ns), "mi.obj", {}, sha256_hex("v 0 0 0\n"), 0.04};
      scan.files = {{"mi.obj", "v 0 0 0\n"}, {"mi.png", std::string(100'000, '\x11')}};
      GNATHION_CHECK_OK(writer.write(scan));
    }
    if (i == 400)
      GNATHION_CHECK_OK(writer.write(
          LedgerSample{header("camera_0", 100, now_ns), LedgerSample::Fate::kRejected, 1, "short read"}));
  }
  return writer.finish();
}

Status write_live(const fs::path& path) {
  SystemClock clock;
  std::vector<std::unique_ptr<Device>> devices;
  const auto add = [&](const char* stream, double rate_hz, std::uint32_t samples,
                       SyntheticDevice::Maker maker) {
    devices.push_back(std::make_unique<SyntheticDevice>(
        SyntheticDevice::Options{stream, rate_hz, samples, -1}, std::move(maker), clock));
  };
  add("camera_0", 60, 120, camera_maker({camera_like_image(320, 240, 3)}));
  add("tracker", 240, 480, tracker_maker());
  add("pedal", 2, 4, pedal_maker());
  SessionOptions options;
  options.software_version = "test";
  GNATHION_TRY(auto session, Session::start(path, std::move(devices), options, clock));
  session->wait_for(100);
  return session->finish();
}

/// Cut in its middle, as a crash leaves it, and recovered.
Status write_recovered(const fs::path& whole, const fs::path& path) {
  GNATHION_TRY(const std::string bytes, read_file(whole));
  const fs::path cut = fs::path(path).replace_extension(".cut");
  GNATHION_CHECK_OK(write_file(cut, std::string_view(bytes).substr(0, bytes.size() * 6 / 10)));
  GNATHION_TRY(const std::uint64_t samples, recover_recording(cut, path));
  (void)samples;
  fs::remove(cut);
  return {};
}

Status write_empty(const fs::path& path) {
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path));
  return writer.finish();
}

Status write_all(const fs::path& folder) {
  for (const char* compression : {"zstd", "lz4", ""}) {
    RecordingOptions options;
    options.compression = compression;
    const std::string name = *compression ? compression : "none";
    GNATHION_CHECK_OK(write_session(folder / (name + ".mcap"), options));
  }
  GNATHION_CHECK_OK(write_live(folder / "live.mcap"));
  GNATHION_CHECK_OK(write_recovered(folder / "zstd.mcap", folder / "recovered.mcap"));
  return write_empty(folder / "empty.mcap");
}

/// Every kind of sample once or twice, as small as can be.
Status write_seed(const fs::path& path, const std::string& compression) {
  RecordingOptions options;
  options.compression = compression;
  options.max_chunk_ns = 20;
  GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(path, options));
  GNATHION_CHECK_OK(writer.attach("rig.toml", "text/plain", "x"));
  for (std::uint32_t i = 0; i < 6; ++i) {
    const std::int64_t now_ns = 1000 + 9 * i;
    const auto header = [&](const char* stream) {
      return SampleHeader{stream, i == 4 ? 9 : i, {now_ns - 5}, {now_ns}, {i}};
    };
    GNATHION_CHECK_OK(writer.write(FrameSample{header("camera_0"), Image8(4, 3, 7)}));
    GNATHION_CHECK_OK(writer.write(PoseSample{header("tracker"), "t", "s", i % 2 == 0, "far", {}}));
    GNATHION_CHECK_OK(writer.write(TransferSample{header("pedal/raw"), 0x81, -7, "ab"}));
    GNATHION_CHECK_OK(writer.write(EventSample{header("pedal"), "MI", true, "x"}));
  }
  const SampleHeader h{"face", 0, {1100}, {1100}, {3}};
  GNATHION_CHECK_OK(writer.write(ScanSample{h, "a", {{"a.obj", "v"}, {"a.png", "p"}}, "00", 0.1}));
  GNATHION_CHECK_OK(writer.write(LedgerSample{h, LedgerSample::Fate::kRejected, 2, "queue full"}));
  return writer.finish();
}

/// The same file with every CRC left out (0), so that a fuzzer comes behind them.
Status write_seed_without_crcs(const fs::path& whole, const fs::path& path) {
  GNATHION_TRY(std::string bytes, read_file(whole));
  std::size_t at = mcap::kMagic.size();
  while (const auto record = mcap::next_record(std::string_view(bytes).substr(at))) {
    const std::size_t content = at + 9, end = at + record->total_size;
    const std::map<mcap::Opcode, std::size_t> crc_at = {{mcap::Opcode::kChunk, content + 24},
                                                        {mcap::Opcode::kAttachment, end - 4},
                                                        {mcap::Opcode::kDataEnd, content},
                                                        {mcap::Opcode::kFooter, content + 16}};
    const auto found = crc_at.find(record->opcode);
    if (found != crc_at.end()) bytes.replace(found->second, 4, 4, '\0');
    at = end;
  }
  return write_file(path, bytes);
}

Status write_seeds(const fs::path& folder) {
  GNATHION_CHECK_OK(write_seed(folder / "every_kind_zstd", "zstd"));
  GNATHION_CHECK_OK(write_seed(folder / "every_kind_lz4", "lz4"));
  GNATHION_CHECK_OK(write_seed(folder / "every_kind_plain", ""));
  return write_seed_without_crcs(folder / "every_kind_plain", folder / "every_kind_without_crcs");
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  if (argc != 2 && argc != 3) return 2;
  const gnathion::Status status = argc == 2 ? gnathion::write_all(argv[1]) : gnathion::write_seeds(argv[2]);
  if (!status) std::fprintf(stderr, "%s\n", status.error().line().c_str());
  return status ? 0 : 1;
}
