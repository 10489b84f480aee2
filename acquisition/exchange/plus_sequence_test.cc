// PLUS sequences: the files of PLUS's own test data, round trips, and what is wrong with others.
#include "acquisition/exchange/plus_sequence.h"

#include "acquisition/exchange/exchange_test_support.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class PlusSequenceTest : public ExchangeTest {
 protected:
  static std::string why(const std::string& bytes) {
    const auto header = parse_plus_header(bytes, "s.igs.mha");
    return header ? std::string("taken") : header.error().why;
  }
};

TEST_F(PlusSequenceTest, DecimalSecondsKeepEveryNanosecond) {
  EXPECT_EQ(decimal_seconds(1'500'000'000), "1.500000000");
  EXPECT_EQ(decimal_seconds(-1), "-0.000000001");
  for (int i = 0; i < 1000; ++i) {
    const auto ns = static_cast<std::int64_t>(random_.next_u32()) * 1'000'000'007 % 9'000'000'000'000'000'000;
    EXPECT_EQ(ns_from_decimal(decimal_seconds(ns)), ns);
    EXPECT_EQ(ns_from_decimal(decimal_seconds(-ns)), -ns);
  }
  EXPECT_EQ(ns_from_decimal("280.4611428572264"), 280'461'142'857);
  EXPECT_EQ(ns_from_decimal("3"), 3'000'000'000);
  EXPECT_EQ(ns_from_decimal(".25 "), 250'000'000);
  EXPECT_EQ(ns_from_decimal("0.9999999996"), 1'000'000'000);
  EXPECT_EQ(ns_from_decimal("1e-3"), 1'000'000);
  for (const char* none : {"", ".", "1.2.3", "nan", "inf", "12 s", "99999999999", "1e300", "-", "--1"})
    EXPECT_FALSE(ns_from_decimal(none)) << none;
}

/// Facts read out of the files with an independent parser.
TEST_F(PlusSequenceTest, TrackerFilesOfPlus) {
  if (plus_data().empty()) GTEST_SKIP() << "PLUS's sequences are not here (GNATHION_SHARED)";
  const auto eight =
      PlusReader::open(plus_data() / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha");
  ASSERT_TRUE(eight) << eight.error().line();
  const PlusSequence& s = eight->sequence();
  ASSERT_EQ(s.frames.size(), 1000u);
  EXPECT_EQ(s.width_px, 0);
  EXPECT_EQ(s.frames[0].timestamp_ns, 280'461'142'857);
  ASSERT_EQ(s.frames[0].transforms.size(), 2u);
  const PlusTransform& stylus = s.frames[0].transforms.at("StylusToTracker");
  EXPECT_TRUE(stylus.valid);
  EXPECT_EQ(stylus.matrix(0, 3), 315.55283203125);
  EXPECT_EQ(stylus.matrix(2, 1), -0.8617411412031651);
  std::int64_t last = 0;
  for (const PlusFrame& f : s.frames) {
    EXPECT_FALSE(f.has_image);
    EXPECT_EQ(f.transforms.size(), 2u);
    EXPECT_GT(*f.timestamp_ns, last);
    last = *f.timestamp_ns;
  }

  const auto twenty = PlusReader::open(plus_data() / "SyntheticTrackerBuffer20.igs.mha");
  ASSERT_TRUE(twenty) << twenty.error().line();
  ASSERT_EQ(twenty->sequence().frames.size(), 20u);
  EXPECT_EQ(twenty->sequence().width_px, 1);
  for (std::size_t i = 0; i < 20; ++i) {
    const PlusFrame& f = twenty->sequence().frames[i];
    EXPECT_EQ(f.number, i + 1);
    EXPECT_EQ(f.timestamp_ns, 1'000'000'000 + static_cast<std::int64_t>(i) * 500'000'000);
    const double up_and_down = i < 10 ? static_cast<double>(i) : std::max(1.0, 18.0 - static_cast<double>(i));
    EXPECT_EQ(f.transforms.at("ToolToTracker").matrix(2, 3), 30 + up_and_down);
  }
}

TEST_F(PlusSequenceTest, ImageFilesOfPlus) {
  if (plus_data().empty()) GTEST_SKIP() << "PLUS's sequences are not here (GNATHION_SHARED)";
  auto sample = PlusReader::open(plus_data() / "NrrdSample.igs.nrrd");
  ASSERT_TRUE(sample) << sample.error().line();
  EXPECT_EQ(sample->sequence().width_px, 256);
  EXPECT_EQ(sample->sequence().height_px, 256);
  EXPECT_EQ(sample->sequence().pixel, PlusPixel::kInt16);
  ASSERT_EQ(sample->sequence().frames.size(), 1u);
  EXPECT_EQ(sample->sequence().fields.at("ultrasound image orientation"), "MFA");
  const auto pixels = sample->next_pixels();
  ASSERT_TRUE(pixels) << pixels.error().line();
  EXPECT_EQ(pixels->size(), 256u * 256u * 2u);
  EXPECT_EQ(sha256_hex(*pixels), "42631482900631042fc19120faedb76863a8cf5558a3ea3a2d9b9aae1ff63b84");
  EXPECT_FALSE(sample->next_pixels());

  const auto external = PlusReader::open(plus_data() / "MetaImageSequenceIOTest1.igs.mhd");
  ASSERT_FALSE(external);  // its pixels were left out of the data
  EXPECT_NE(external.error().why.find("MetaImageSequenceIOTest1.zraw"), std::string::npos);
}

TEST_F(PlusSequenceTest, DataBesideTheHeader) {
  const std::string header =
      "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nSeq_Frame0001_Timestamp = 2\n"
      "ElementDataFile = s.raw";  // the last line may lack its end
  file("s.mhd", header);
  file("s.raw", "abcdefgh");
  auto reader = PlusReader::open(folder_ / "s.mhd");
  ASSERT_TRUE(reader) << reader.error().line();
  EXPECT_EQ(*reader->next_pixels(), "abcd");
  EXPECT_EQ(*reader->next_pixels(), "efgh");
  file("t.mhd", "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = ../s.raw\n");
  EXPECT_FALSE(PlusReader::open(folder_ / "t.mhd"));  // never out of the folder
}

TEST_F(PlusSequenceTest, WhatIsWrittenIsReadAgainBitForBit) {
  for (const bool images : {false, true})
    for (const bool compressed : {false, true})
      for (const char* name : {"s.igs.mha", "s.igs.nrrd"}) {
        PlusSequence truth;
        std::vector<Image8> pictures;
        if (images) {
          truth.width_px = 37;
          truth.height_px = 23;
        }
        truth.fields["Note"] = "two words";
        for (std::uint32_t i = 0; i < 40; ++i) {
          PlusFrame f;
          f.number = 5 + i;
          f.timestamp_ns = 123'456'789'012 + i * 16'666'667LL;
          f.unfiltered_timestamp_ns = *f.timestamp_ns + 7'000'001;
          f.has_image = images && i % 7 != 3;
          f.transforms["BowToCamera"] = {random_pose().matrix(), i % 5 != 0, i % 5 != 0 ? "OK" : "INVALID"};
          f.fields["Mark"] = std::to_string(i);
          truth.frames.push_back(f);
          pictures.push_back(random_image(37, 23));
        }
        const Status written = write_plus_sequence(folder_ / name, truth,
                                                   [&](std::size_t i) -> Result<std::optional<Image8>> {
                                                     if (!truth.frames[i].has_image)
                                                       return std::optional<Image8>();
                                                     return std::optional<Image8>(pictures[i]);
                                                   },
                                                   {compressed});
        ASSERT_TRUE(written) << written.error().line();
        auto reader = PlusReader::open(folder_ / name);
        ASSERT_TRUE(reader) << reader.error().line();
        const PlusSequence& got = reader->sequence();
        EXPECT_EQ(got.fields.at("Note"), "two words");
        ASSERT_EQ(got.frames.size(), truth.frames.size());
        for (std::size_t i = 0; i < got.frames.size(); ++i) {
          const PlusFrame &a = got.frames[i], &b = truth.frames[i];
          EXPECT_EQ(a.number, b.number);
          EXPECT_EQ(a.timestamp_ns, b.timestamp_ns);
          EXPECT_EQ(a.unfiltered_timestamp_ns, b.unfiltered_timestamp_ns);
          EXPECT_EQ(a.has_image, b.has_image);
          EXPECT_EQ(a.fields.at("Mark"), b.fields.at("Mark"));
          EXPECT_EQ(a.transforms.at("BowToCamera").matrix, b.transforms.at("BowToCamera").matrix);
          EXPECT_EQ(a.transforms.at("BowToCamera").valid, b.transforms.at("BowToCamera").valid);
          if (!images) continue;
          const auto pixels = reader->next_pixels();
          ASSERT_TRUE(pixels) << pixels.error().line();
          const Image8 blank(37, 23);
          const auto& expected = b.has_image ? pictures[i].pixels : blank.pixels;
          EXPECT_EQ(*pixels, std::string(expected.begin(), expected.end()));
        }
        std::size_t files = 0;
        for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder_)) ++files;
        EXPECT_EQ(files, 1u);  // nothing half-written beside it
        fs::remove(folder_ / name);
      }
}

TEST_F(PlusSequenceTest, BigEndianAndChannels) {
  file("b.mha",
       std::string("NDims = 3\nDimSize = 2 1 1\nElementType = MET_USHORT\nBinaryDataByteOrderMSB = True\n"
                   "ElementDataFile = LOCAL\n\x01\x02\x03\x04"));
  auto reader = PlusReader::open(folder_ / "b.mha");
  ASSERT_TRUE(reader) << reader.error().line();
  EXPECT_EQ(*reader->next_pixels(), "\x02\x01\x04\x03");
  file("c.nrrd",
       "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 3 2 1 2\nkinds: RGB-color domain domain list\n"
       "encoding: raw\n\nabcdefghijkl");
  auto colour = PlusReader::open(folder_ / "c.nrrd");
  ASSERT_TRUE(colour) << colour.error().line();
  EXPECT_EQ(colour->sequence().channels, 3);
  EXPECT_EQ(colour->sequence().frames.size(), 2u);
  EXPECT_EQ(*colour->next_pixels(), "abcdef");
}

TEST_F(PlusSequenceTest, WhatIsWrongIsNamed) {
  EXPECT_EQ(why("\x89PNG\r\n"), "is neither MetaImage nor NRRD");
  EXPECT_EQ(why("NDims = 3\nDimSize = 1 1 1\n"), "its header has no end");
  EXPECT_EQ(why("DimSize = 1 x 1\nElementDataFile = LOCAL\n"), "line 1: DimSize is not a list of sizes");
  EXPECT_EQ(why("DimSize = 0 0 2\nSeq_Frame0002_Timestamp = 1\nElementDataFile = LOCAL\n"),
            "frame 2 of 2 announced");
  EXPECT_EQ(why("DimSize = 0 0 2\nSeq_Frame0000_ToolToTrackerTransform = 1 0 0\nElementDataFile = LOCAL\n"),
            "line 2: ToolToTrackerTransform has 3 numbers; a transform has 16");
  EXPECT_EQ(why("DimSize = 0 0 2\nSeq_Frame0000_Timestamp = soon\nElementDataFile = LOCAL\n"),
            "line 2: Timestamp is no time in seconds");
  EXPECT_EQ(why("DimSize = 0 0 4000000000\nElementDataFile = LOCAL\n"),
            "announces 4000000000 frames and describes 0");
  EXPECT_EQ(why("DimSize = 1 1 1 1 1 1\nElementDataFile = LOCAL\n"),
            "line 1: DimSize is not a list of sizes");
  EXPECT_EQ(why("DimSize = 99999 1 1\nElementDataFile = LOCAL\n"), "images of 99999×1 pixels");
  const auto truncated = PlusReader::parse(
      "DimSize = 60000 60000 90000\nElementType = MET_UCHAR\nElementDataFile = LOCAL\nabc", "t");
  ASSERT_FALSE(truncated);
  EXPECT_NE(truncated.error().why.find("truncated"), std::string::npos);
  auto damaged = PlusReader::parse(
      "DimSize = 4 4 1\nElementType = MET_UCHAR\nCompressedData = True\nElementDataFile = LOCAL\nnot zlib",
      "t");
  ASSERT_TRUE(damaged);
  const auto pixels = damaged->next_pixels();
  ASSERT_FALSE(pixels);
  EXPECT_NE(pixels.error().why.find("damaged"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
