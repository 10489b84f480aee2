#include "acquisition/recording.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "acquisition/mcap_format.h"
#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class RecordingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_recording_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

FrameSample frame(std::uint32_t sequence, Random& random) {
  FrameSample f;
  f.header = {"camera_0",
              sequence,
              {sequence * 16'666'667LL},
              {sequence * 16'666'667LL + 9'000'000},
              {7 + sequence * 16'666'000LL}};
  f.image = Image8(64, 48);
  for (auto& p : f.image.pixels) p = static_cast<std::uint8_t>(random.below(256));
  return f;
}

std::vector<Sample> session(std::uint64_t seed) {
  Random random(seed);
  std::vector<Sample> samples;
  for (std::uint32_t i = 0; i < 200; ++i) {
    if (i == 50 || i == 51 || i == 120) continue;  // lost by the device
    samples.push_back(frame(i, random));
    if (i == 80)
      samples.push_back(EventSample{
          {"pedal", 3, {80 * 16'666'667LL}, {80 * 16'666'667LL + 9'500'000}, {42}}, "TP", true, "first"});
  }
  return samples;
}

void write_session(const fs::path& path, const std::vector<Sample>& samples) {
  auto writer = RecordingWriter::create(path);
  ASSERT_TRUE(writer);
  for (const Sample& s : samples) ASSERT_TRUE(writer->write(s));
  ASSERT_TRUE(writer->attach("rig.toml", "text/plain", "bow = 1\n"));
  ASSERT_TRUE(writer->finish());
}

bool same_header(const SampleHeader& a, const SampleHeader& b) {
  return a.stream == b.stream && a.sequence == b.sequence && a.capture == b.capture &&
         a.arrival == b.arrival && a.device == b.device;
}

TEST_F(RecordingTest, ReplaysTheSameSamplesBitForBit) {
  const auto samples = session(0x51ce);
  write_session(folder_ / "a.mcap", samples);
  auto source = RecordingSource::open(folder_ / "a.mcap");
  ASSERT_TRUE(source) << source.error().line();
  std::size_t i = 0, gaps = 0;
  while (true) {
    auto next = (*source)->next();
    ASSERT_TRUE(next) << next.error().line();
    if (!*next) break;
    if (const auto* line = std::get_if<LedgerSample>(&**next)) {
      EXPECT_EQ(line->fate, LedgerSample::Fate::kMissing);
      gaps += line->count;
      continue;
    }
    ASSERT_LT(i, samples.size());
    ASSERT_TRUE(same_header(header_of(**next), header_of(samples[i])));
    if (const auto* f = std::get_if<FrameSample>(&**next)) {
      ASSERT_EQ(f->image.pixels, std::get<FrameSample>(samples[i]).image.pixels);
    } else {
      EXPECT_EQ(std::get<EventSample>(**next).kind, std::get<EventSample>(samples[i]).kind);
    }
    ++i;
  }
  EXPECT_EQ(i, samples.size());
  EXPECT_EQ(gaps, 3u);
}

TEST_F(RecordingTest, SummaryCountsEverySampleAndEveryLoss) {
  write_session(folder_ / "a.mcap", session(2));
  const auto summary = summarise_recording(folder_ / "a.mcap");
  ASSERT_TRUE(summary);
  EXPECT_TRUE(summary->whole);
  EXPECT_EQ(summary->streams.at("camera_0").received, 197u);
  EXPECT_EQ(summary->streams.at("camera_0").missing, 3u);
  EXPECT_NEAR(summary->streams.at("camera_0").rate_hz, 60.0, 0.01);
  EXPECT_NEAR(summary->streams.at("camera_0").longest_gap_s, 0.05, 1e-4);
  EXPECT_EQ(summary->streams.at("pedal").received, 1u);
}

TEST_F(RecordingTest, CutAnywhereIsRefusedAndRecovered) {
  write_session(folder_ / "a.mcap", session(3));
  const std::string whole = *read_file(folder_ / "a.mcap");
  Random random(99);
  std::uint64_t last_saved = 0;
  for (int k = 1; k <= 20; ++k) {
    const auto cut = static_cast<std::size_t>(static_cast<double>(whole.size() - 1) * k / 20.0);
    ASSERT_TRUE(write_file(folder_ / "cut.mcap", std::string_view(whole).substr(0, cut)));
    const auto refused = RecordingSource::open(folder_ / "cut.mcap");
    ASSERT_FALSE(refused);
    EXPECT_EQ(exit_code(refused.error().code), 4);
    EXPECT_NE(refused.error().why.find("cut off"), std::string::npos);
    const auto saved = recover_recording(folder_ / "cut.mcap", folder_ / "saved.mcap");
    ASSERT_TRUE(saved) << saved.error().line();
    EXPECT_GE(*saved, last_saved);
    last_saved = *saved;
    ASSERT_TRUE(RecordingSource::open(folder_ / "saved.mcap"));
    const auto summary = summarise_recording(folder_ / "saved.mcap");
    ASSERT_TRUE(summary);
    EXPECT_TRUE(summary->whole);
  }
  EXPECT_EQ(last_saved, 197u + 1u + 2u);  // frames, the mark, and the two gap lines
}

TEST_F(RecordingTest, FlippedByteIsFoundByItsCrc) {
  write_session(folder_ / "a.mcap", session(4));
  std::string bytes = *read_file(folder_ / "a.mcap");
  const std::size_t at = bytes.size() / 2;
  bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
  ASSERT_TRUE(write_file(folder_ / "bad.mcap", bytes));
  const auto summary = summarise_recording(folder_ / "bad.mcap");
  ASSERT_TRUE(summary);
  EXPECT_FALSE(summary->whole);
  EXPECT_LE(summary->damage_begin, at);
  EXPECT_GT(summary->damage_end, at);
}

TEST_F(RecordingTest, RecoveryGoesOnBehindADamagedChunk) {
  write_session(folder_ / "a.mcap", session(8));
  std::string bytes = *read_file(folder_ / "a.mcap");
  for (std::size_t at = bytes.size() / 2; at < bytes.size() / 2 + 3; ++at)
    bytes[at] = static_cast<char>(~bytes[at]);
  ASSERT_TRUE(write_file(folder_ / "bad.mcap", bytes));
  const auto saved = recover_recording(folder_ / "bad.mcap", folder_ / "saved.mcap");
  ASSERT_TRUE(saved) << saved.error().line();
  const auto summary = summarise_recording(folder_ / "saved.mcap");
  ASSERT_TRUE(summary && summary->whole);
  const StreamSummary& camera = summary->streams.at("camera_0");
  EXPECT_GT(camera.received, 180u);                   // one chunk of at most 100 ms is lost
  EXPECT_EQ(camera.received + camera.missing, 200u);  // and every lost frame has its line
  EXPECT_GT(camera.last_s, 3.2);
}

TEST_F(RecordingTest, DamageBehindTheMessagesIsFoundToo) {
  write_session(folder_ / "a.mcap", session(7));
  const std::string whole = *read_file(folder_ / "a.mcap");
  for (const std::size_t from_end : {20u, 200u, 1000u}) {
    std::string bytes = whole;
    bytes[bytes.size() - from_end] = static_cast<char>(bytes[bytes.size() - from_end] ^ 1);
    ASSERT_TRUE(write_file(folder_ / "bad.mcap", bytes));
    EXPECT_FALSE(summarise_recording(folder_ / "bad.mcap")->whole) << from_end;
    ASSERT_TRUE(write_file(folder_ / "cut.mcap", std::string_view(whole).substr(0, whole.size() - from_end)));
    EXPECT_FALSE(summarise_recording(folder_ / "cut.mcap")->whole) << from_end;
  }
}

TEST_F(RecordingTest, GarbageNeverCrashesAndIsNamed) {
  Random random(5);
  for (int k = 0; k < 200; ++k) {
    std::string bytes(mcap::kMagic);
    const std::uint32_t n = random.below(400);
    for (std::uint32_t i = 0; i < n; ++i) bytes += static_cast<char>(random.below(i % 9 == 1 ? 20 : 256));
    bytes += std::string(mcap::kMagic);
    ASSERT_TRUE(write_file(folder_ / "garbage.mcap", bytes));
    auto source = RecordingSource::open(folder_ / "garbage.mcap");
    ASSERT_TRUE(source);
    for (int guard = 0; guard < 1000; ++guard) {
      const auto next = (*source)->next();
      if (!next || !*next) break;
    }
  }
  ASSERT_TRUE(write_file(folder_ / "text.mcap", "not a recording"));
  EXPECT_FALSE(RecordingSource::open(folder_ / "text.mcap"));
  EXPECT_FALSE(RecordingSource::open(folder_ / "absent.mcap"));
}

TEST(Mcap, CrcIsThatOfZlib) {
  EXPECT_EQ(mcap::crc32("123456789"), 0xCBF43926u);
}

TEST(Mcap, CompressionsRoundTrip) {
  std::string bytes;
  Random random(6);
  for (int i = 0; i < 100000; ++i) bytes += static_cast<char>(random.below(16));
  for (const char* kind : {"", "lz4", "zstd"}) {
    const std::string packed = mcap::compress(bytes, kind);
    mcap::Chunk chunk{0, 0, bytes.size(), mcap::crc32(bytes), kind, packed};
    EXPECT_EQ(*mcap::decompress(chunk, "test"), bytes) << kind;
    chunk.uncompressed_crc ^= 1;
    EXPECT_FALSE(mcap::decompress(chunk, "test")) << kind;
  }
}

}  // namespace
}  // namespace gnathion
