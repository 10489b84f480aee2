#include "acquisition/recording.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
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

/// Without a sync, of which these tests would make hundreds.
bool put_file(const fs::path& path, std::string_view bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return out.good();
}

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

/// Every kind of sample, with the values that are hard to keep.
std::vector<Sample> every_kind(std::uint64_t seed) {
  Random random(seed);
  std::vector<Sample> samples;
  std::int64_t now_ns = 1'700'000'000'000'000'000;
  const auto header = [&](const std::string& stream, std::uint32_t sequence) {
    now_ns += 3'000'000 + random.below(1'000'000);
    // Arrivals of several devices are not quite in order.
    return SampleHeader{stream,
                        sequence,
                        {now_ns - 8'000'000},
                        {now_ns - static_cast<std::int64_t>(random.below(2'000'000))},
                        {static_cast<std::int64_t>(random.next_u32())}};
  };
  for (std::uint32_t i = 0; i < 60; ++i) {
    FrameSample f = frame(i, random);
    f.header = header("camera_0", i);
    samples.push_back(f);
    PoseSample pose{header("tracker", i),
                    "transmitter",
                    "sensor_" + std::to_string(i % 2),
                    i % 7 != 3,
                    i % 7 == 3 ? "distorted" : "",
                    Rigid3{random.rotation(), 1e3 * random.normal3()}};
    if (i == 20) pose.reference_from_body.translation_mm.x() = std::nan("");
    if (i == 21) pose.reference_from_body.rotation(0, 0) = -0.0;
    samples.push_back(pose);
    std::string data;
    for (std::uint32_t k = random.below(70); k > 0; --k) data += static_cast<char>(random.below(256));
    samples.push_back(TransferSample{header("pedal/raw", i), 0x81, i % 9 == 0 ? -7 : 0, data});
  }
  samples.push_back(EventSample{header("pedal", 0), "TP", true, "Kiefer entspannt \xE2\x9C\x93"});
  samples.push_back(EventSample{header("camera_0/state", 0), "device", false, "unplugged"});
  samples.push_back(EventSample{header("camera_0", 7), "note", true, "an event on a camera's stream"});
  samples.push_back(EventSample{header("ledger", 0), "note", true, "a stream of that name"});
  ScanSample scan{header("face", 0), "mi.obj", {}, sha256_hex("v 0 0 0"), 0.031};
  scan.files = {{"mi.obj", "v 0 0 0"},
                {"mi.mtl", "newmtl skin"},
                {"face.png", std::string(7000, '\x07')},
                {"empty", ""}};
  samples.push_back(scan);
  scan.header = header("face", 1);  // the same name again, though it should not be
  scan.files["mi.obj"] = "v 1 1 1";
  samples.push_back(scan);
  samples.push_back(LedgerSample{header("camera_0", 60), LedgerSample::Fate::kRejected, 2, "queue full"});
  samples.push_back(
      LedgerSample{header("camera_0", 62), LedgerSample::Fate::kAccepted, 1, "said by the device"});
  FrameSample empty;
  empty.header = header("camera_0", 63);
  samples.push_back(empty);
  return samples;
}

bool same_bits(double a, double b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

bool same(const Sample& a, const Sample& b) {
  if (a.index() != b.index() || !same_header(header_of(a), header_of(b))) return false;
  if (const auto* x = std::get_if<FrameSample>(&a)) {
    const auto& y = std::get<FrameSample>(b);
    return x->image.width_px == y.image.width_px && x->image.height_px == y.image.height_px &&
           x->image.pixels == y.image.pixels;
  }
  if (const auto* x = std::get_if<EventSample>(&a)) {
    const auto& y = std::get<EventSample>(b);
    return x->kind == y.kind && x->pressed == y.pressed && x->text == y.text;
  }
  if (const auto* x = std::get_if<LedgerSample>(&a)) {
    const auto& y = std::get<LedgerSample>(b);
    return x->fate == y.fate && x->count == y.count && x->reason == y.reason;
  }
  if (const auto* x = std::get_if<PoseSample>(&a)) {
    const auto& y = std::get<PoseSample>(b);
    for (int i = 0; i < 3; ++i) {
      if (!same_bits(x->reference_from_body.translation_mm(i), y.reference_from_body.translation_mm(i)))
        return false;
      for (int j = 0; j < 3; ++j)
        if (!same_bits(x->reference_from_body.rotation(i, j), y.reference_from_body.rotation(i, j)))
          return false;
    }
    return x->reference == y.reference && x->body == y.body && x->valid == y.valid && x->reason == y.reason;
  }
  if (const auto* x = std::get_if<ScanSample>(&a)) {
    const auto& y = std::get<ScanSample>(b);
    return x->name == y.name && x->files == y.files && x->sha256 == y.sha256 &&
           same_bits(x->deviation_mm, y.deviation_mm);
  }
  const auto& x = std::get<TransferSample>(a);
  const auto& y = std::get<TransferSample>(b);
  return x.endpoint == y.endpoint && x.status == y.status && x.data == y.data;
}

std::vector<Sample> read_all(RecordingSource& source) {
  std::vector<Sample> samples;
  while (true) {
    auto next = source.next();
    EXPECT_TRUE(next) << next.error().line();
    if (!next || !*next) return samples;
    samples.push_back(std::move(**next));
  }
}

void expect_same(const std::vector<Sample>& got, const std::vector<Sample>& expected) {
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t i = 0; i < got.size(); ++i)
    ASSERT_TRUE(same(got[i], expected[i])) << i << " on " << header_of(expected[i]).stream;
}

TEST_F(RecordingTest, EveryKindOfSampleComesBackBitForBit) {
  for (const char* compression : {"zstd", "lz4", ""}) {
    const std::vector<Sample> samples = every_kind(0xA11);
    auto writer = RecordingWriter::create(folder_ / "all.mcap", {compression, 50'000'000, 100'000, true});
    ASSERT_TRUE(writer) << writer.error().line();
    for (const Sample& s : samples) ASSERT_TRUE(writer->write(s));
    ASSERT_TRUE(writer->finish());
    auto source = RecordingSource::open(folder_ / "all.mcap");
    ASSERT_TRUE(source) << source.error().line();
    expect_same(read_all(**source), samples);
    ASSERT_TRUE(recover_recording(folder_ / "all.mcap", folder_ / "again.mcap"));
    auto again = RecordingSource::open(folder_ / "again.mcap");
    expect_same(read_all(**again), samples);
  }
}

TEST_F(RecordingTest, AnyStartTimeGivesTheRestOfTheWholeReplay) {
  const std::vector<Sample> samples = every_kind(0x5EE);
  auto writer = RecordingWriter::create(folder_ / "all.mcap", {"zstd", 20'000'000, 10'000, true});
  for (const Sample& s : samples) ASSERT_TRUE(writer->write(s));
  ASSERT_TRUE(writer->finish());
  auto source = RecordingSource::open(folder_ / "all.mcap");
  ASSERT_TRUE(source);
  const auto range = (*source)->time_range();
  ASSERT_TRUE(range);
  Random random(77);
  for (int k = 0; k < 60; ++k) {
    // Also the very instants of samples, the ends, and beyond.
    HostTime from = header_of(samples[random.below(static_cast<std::uint32_t>(samples.size()))]).arrival;
    if (k % 3 == 1) from.ns += static_cast<std::int64_t>(random.below(10'000'000));
    if (k == 2) from = range->first;
    if (k == 5) from = range->second;
    if (k == 8) from.ns = range->second.ns + 1;
    if (k == 11) from.ns = 0;
    ASSERT_TRUE((*source)->seek(from));
    std::vector<Sample> expected;
    for (const Sample& s : samples)
      if (header_of(s).arrival >= from) expected.push_back(s);
    expect_same(read_all(**source), expected);
  }
}

TEST_F(RecordingTest, TextThatIsNotUtf8IsMendedNotLost) {
  auto writer = RecordingWriter::create(folder_ / "a.mcap");
  ASSERT_TRUE(writer->write(EventSample{{"pedal\xFF", 1, {1}, {2}, {3}}, "no\xC3te", true, "\x80"}));
  ASSERT_TRUE(writer->finish());
  auto source = RecordingSource::open(folder_ / "a.mcap");
  const std::vector<Sample> samples = read_all(**source);
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(std::get<EventSample>(samples[0]).kind, "no\xEF\xBF\xBDte");
  EXPECT_EQ(header_of(samples[0]).stream, "pedal\xEF\xBF\xBD");
}

TEST_F(RecordingTest, CountersMayWrapBeginAnewAndRepeat) {
  Random random(4);
  auto writer = RecordingWriter::create(folder_ / "a.mcap");
  const auto put = [&](std::uint32_t sequence) {
    FrameSample f = frame(0, random);
    f.header.sequence = sequence;
    ASSERT_TRUE(writer->write(f));
  };
  for (const std::uint32_t s : {0xFFFFFFFEu, 0xFFFFFFFFu, 0u, 1u, 4u}) put(s);  // 2 and 3 are missing
  for (const std::uint32_t s : {1000u, 0u, 1u}) put(s);                         // 995 missing, then a reset
  ASSERT_TRUE(writer->write(
      LedgerSample{{"camera_0", 1, {}, {}, {}}, LedgerSample::Fate::kRejected, 1, "duplicate"}));
  put(2);
  EXPECT_EQ(writer->ledger().at("camera_0").missing, 2u + 995u);
  EXPECT_EQ(writer->ledger().at("camera_0").received, 9u);
  ASSERT_TRUE(writer->finish());
}

TEST_F(RecordingTest, AttachmentsAreReadOneByOne) {
  auto writer = RecordingWriter::create(folder_ / "a.mcap");
  ASSERT_TRUE(writer->attach("rig.toml", "text/plain", "bow = 1"));
  for (const Sample& s : session(9)) ASSERT_TRUE(writer->write(s));
  ASSERT_TRUE(writer->attach("big", "application/octet-stream", std::string(3 << 20, 'x')));
  ASSERT_TRUE(writer->finish());
  auto source = RecordingSource::open(folder_ / "a.mcap");
  ASSERT_TRUE(source);
  ASSERT_EQ((*source)->attachments().size(), 2u);
  EXPECT_EQ((*source)->attachments()[0].media_type, "text/plain");
  EXPECT_EQ(*(*source)->attachment("rig.toml"), "bow = 1");
  EXPECT_EQ((*source)->attachment("big")->size(), std::size_t{3} << 20);
  EXPECT_FALSE((*source)->attachment("small"));
}

/// Whatever byte is damaged, verify finds it, and the range that it names holds that byte.
TEST_F(RecordingTest, EveryDamagedByteIsFoundAndNamed) {
  auto writer = RecordingWriter::create(folder_ / "a.mcap", {"zstd", 50'000'000, 20'000, true});
  ASSERT_TRUE(writer->attach("rig.toml", "text/plain", "bow = 1"));
  for (const Sample& s : every_kind(3)) ASSERT_TRUE(writer->write(s));
  ASSERT_TRUE(writer->finish());
  const std::string whole = *read_file(folder_ / "a.mcap");
  ASSERT_TRUE(summarise_recording(folder_ / "a.mcap")->whole);
  Random random(0xF11F);
  std::size_t narrow = 0, flips = 0;
  for (; flips < 400; ++flips) {
    const std::size_t at = flips < 60 ? mcap::kMagic.size() + flips
                                      : 8 + random.below(static_cast<std::uint32_t>(whole.size() - 8));
    std::string bytes = whole;
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random.below(8)));
    ASSERT_TRUE(put_file(folder_ / "bad.mcap", bytes));
    const auto summary = summarise_recording(folder_ / "bad.mcap");
    ASSERT_TRUE(summary) << summary.error().line();
    ASSERT_FALSE(summary->whole) << "byte " << at;
    EXPECT_LE(summary->damage_begin, at) << summary->damage;
    EXPECT_GT(summary->damage_end, at) << summary->damage;
    narrow += summary->damage_end - summary->damage_begin < 40'000;
    if (flips % 5 != 0) continue;
    const auto saved = recover_recording(folder_ / "bad.mcap", folder_ / "saved.mcap");
    ASSERT_TRUE(saved) << at << ": " << saved.error().line();
    ASSERT_TRUE(summarise_recording(folder_ / "saved.mcap")->whole) << at;
    auto source = RecordingSource::open(folder_ / "saved.mcap");
    ASSERT_TRUE(source);
    read_all(**source);
  }
  EXPECT_GT(narrow, flips * 9 / 10);
}

TEST_F(RecordingTest, RecoveryFindsItsWayBehindADamagedLength) {
  write_session(folder_ / "a.mcap", session(8));
  std::string bytes = *read_file(folder_ / "a.mcap");
  // The length of the third chunk, by walking the records.
  std::size_t at = mcap::kMagic.size(), chunks = 0;
  while (true) {
    const auto record = mcap::next_record(std::string_view(bytes).substr(at));
    ASSERT_TRUE(record);
    if (record->opcode == mcap::Opcode::kChunk && ++chunks == 3) break;
    at += record->total_size;
  }
  bytes[at + 6] = '\x7F';
  ASSERT_TRUE(put_file(folder_ / "bad.mcap", bytes));
  ASSERT_TRUE(recover_recording(folder_ / "bad.mcap", folder_ / "saved.mcap"));
  const auto summary = summarise_recording(folder_ / "saved.mcap");
  const StreamSummary& camera = summary->streams.at("camera_0");
  EXPECT_GT(camera.received, 180u);
  EXPECT_EQ(camera.received + camera.missing, 200u);
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
    ASSERT_TRUE(put_file(folder_ / "cut.mcap", std::string_view(whole).substr(0, cut)));
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
  ASSERT_TRUE(put_file(folder_ / "bad.mcap", bytes));
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
  ASSERT_TRUE(put_file(folder_ / "bad.mcap", bytes));
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
    ASSERT_TRUE(put_file(folder_ / "bad.mcap", bytes));
    EXPECT_FALSE(summarise_recording(folder_ / "bad.mcap")->whole) << from_end;
    ASSERT_TRUE(put_file(folder_ / "cut.mcap", std::string_view(whole).substr(0, whole.size() - from_end)));
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
    ASSERT_TRUE(put_file(folder_ / "garbage.mcap", bytes));
    auto source = RecordingSource::open(folder_ / "garbage.mcap");
    ASSERT_TRUE(source);
    for (int guard = 0; guard < 1000; ++guard) {
      const auto next = (*source)->next();
      if (!next || !*next) break;
    }
  }
  ASSERT_TRUE(put_file(folder_ / "text.mcap", "not a recording"));
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
