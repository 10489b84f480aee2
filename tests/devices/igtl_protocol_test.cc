// The decoder against messages that the OpenIGTLink library packed, whole and damaged.
#include <gtest/gtest.h>
#include <igtl_util.h>

#include <chrono>

#include "acquisition/igtl/igtl_messages.h"
#include "core/random.h"
#include "tests/devices/igtl_pack.h"

namespace gnathion {
namespace {

using igtl::Framer;
using igtl::Header;
using igtl::Item;

Rigid3 random_pose(Random& random) {
  return {random.rotation(), 200 * random.normal3()};
}

std::string random_bytes(Random& random, std::size_t n) {
  std::string bytes(n, '\0');
  for (char& c : bytes) c = static_cast<char>(random.below(256));
  return bytes;
}

struct Decoded {
  Header header;
  Result<igtl::Body> body;
};
Decoded decode_one(const std::string& bytes) {
  Framer framer;
  framer.feed(bytes);
  const auto item = framer.next();
  EXPECT_TRUE(item && item->kind == Item::Kind::kMessage) << (item ? item->reason : "nothing came");
  const auto content = igtl::content_of(item->header, item->body);
  EXPECT_TRUE(content);
  return {item->header, igtl::decode(item->header.type, content->bytes)};
}

/// Single precision: 200 mm and 1 have so many digits.
void expect_pose(const Rigid3& got, const Rigid3& truth) {
  const Vector6 d = difference(got, truth);
  EXPECT_LT(d.head<3>().norm(), 1e-6);
  EXPECT_LT((got.translation_mm - truth.translation_mm).norm(), 2e-4);
}

class IgtlProtocol : public ::testing::Test {
 protected:
  IgtlProtocol()
      : seed_(static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count())),
        random_(seed_) {
    RecordProperty("seed", std::to_string(seed_));
  }
  const std::uint64_t seed_;
  Random random_;
};

TEST_F(IgtlProtocol, ChecksumIsTheLibrarys) {
  for (std::size_t n = 0; n < 300; n += 7) {
    std::string bytes = random_bytes(random_, n);
    EXPECT_EQ(igtl::crc64(bytes), ::crc64(reinterpret_cast<unsigned char*>(bytes.data()), n, 0));
  }
}

TEST_F(IgtlProtocol, TransformComesAsItWasSent) {
  for (int i = 0; i < 50; ++i) {
    const Rigid3 pose = random_pose(random_);
    const std::int64_t ns = 1'700'000'000'000'000'000 + random_.below(1'000'000'000);
    const Decoded d = decode_one(igtl_pack::transform("StylusToTracker", pose.matrix(), ns));
    EXPECT_EQ(d.header.type, "TRANSFORM");
    EXPECT_EQ(d.header.device, "StylusToTracker");
    // The library adds up 30 bits, each cut to whole ns.
    EXPECT_LE(std::abs(d.header.timestamp_ns() - ns), 30) << seed_;
    ASSERT_TRUE(d.body);
    const auto& tools = std::get<igtl::Poses>(*d.body).tools;
    ASSERT_EQ(tools.size(), 1u);
    EXPECT_EQ(tools[0].fault, "");
    expect_pose(tools[0].reference_from_tool, pose);
  }
}

TEST_F(IgtlProtocol, TimeIsSecondsIn32BitsAndTheirFraction) {
  Header h;
  h.timestamp = (std::uint64_t{1'700'000'000} << 32) + (1u << 31) + (1u << 29);
  EXPECT_EQ(h.timestamp_ns(), 1'700'000'000'625'000'000);
  h.timestamp = ~std::uint64_t{0};
  EXPECT_EQ(h.timestamp_ns(), 4'294'967'296'000'000'000);  // the last instant, rounded
}

TEST_F(IgtlProtocol, WhatIsNoRotationIsNoPose) {
  Matrix4 scaled = random_pose(random_).matrix();
  scaled.topLeftCorner<3, 3>() *= 1.002;
  Matrix4 mirrored = random_pose(random_).matrix();
  mirrored.col(0) *= -1;
  Matrix4 nan = Matrix4::Identity();
  nan(1, 3) = std::nan("");
  for (const auto& [m, fault] : std::vector<std::pair<Matrix4, std::string>>{
           {scaled, "not a rotation"}, {mirrored, "not a rotation"}, {nan, "not finite"}}) {
    const Decoded d = decode_one(igtl_pack::transform("T", m, 0));
    ASSERT_TRUE(d.body);
    EXPECT_EQ(std::get<igtl::Poses>(*d.body).tools[0].fault, fault);
  }
  Matrix4 rounded = random_pose(random_).matrix();  // as recorded trackers do: see igtl_messages.cc
  rounded.topLeftCorner<3, 3>() *= 1.0002;
  const Decoded d = decode_one(igtl_pack::transform("T", rounded, 0));
  EXPECT_EQ(std::get<igtl::Poses>(*d.body).tools[0].fault, "");
}

TEST_F(IgtlProtocol, TrackingDataOfSeveralTools) {
  for (const bool quaternions : {false, true}) {
    const std::vector<igtl_pack::Tool> tools = {{"Channel 0", random_pose(random_), 1},
                                                {"Channel 1", random_pose(random_), 2},
                                                {"tip", {Matrix3::Zero(), 200 * random_.normal3()}, 3}};
    const std::string bytes =
        quaternions ? igtl_pack::qtdata("Tracker", tools, 5) : igtl_pack::tdata("Tracker", tools, 5);
    const Decoded d = decode_one(bytes);
    EXPECT_EQ(d.header.type, quaternions ? "QTDATA" : "TDATA");
    ASSERT_TRUE(d.body);
    const auto& got = std::get<igtl::Poses>(*d.body).tools;
    ASSERT_EQ(got.size(), tools.size());
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_EQ(got[i].name, tools[i].name);
      EXPECT_EQ(got[i].fault, "");
      EXPECT_EQ(got[i].position_only, tools[i].type == 3);
      // A "3D" instrument has no orientation, whatever stands in its place.
      expect_pose(got[i].reference_from_tool, tools[i].type == 3
                                                  ? Rigid3::from_translation(tools[i].pose.translation_mm)
                                                  : tools[i].pose);
    }
  }
}

TEST_F(IgtlProtocol, GreyAndColourImages) {
  Image8 grey(61, 47);
  for (auto& p : grey.pixels) p = static_cast<std::uint8_t>(random_.below(256));
  Decoded d = decode_one(igtl_pack::image("cam", grey, 7));
  ASSERT_TRUE(d.body) << d.body.error().line();
  const Image8& got = std::get<igtl::Picture>(*d.body).image;
  EXPECT_EQ(got.width_px, 61);
  EXPECT_EQ(got.height_px, 47);
  EXPECT_EQ(got.pixels, grey.pixels);

  const std::string rgb = random_bytes(random_, 10 * 10 * 3);
  d = decode_one(igtl_pack::image("cam", 10, 10, 1, ::igtl::ImageMessage::TYPE_UINT8, 3, rgb, 7));
  ASSERT_TRUE(d.body) << d.body.error().line();
  for (std::size_t i = 0; i < 100; ++i) {
    const auto channel = [&](std::size_t c) {
      return static_cast<double>(static_cast<unsigned char>(rgb[3 * i + c]));
    };
    const double luma = 0.299 * channel(0) + 0.587 * channel(1) + 0.114 * channel(2);
    EXPECT_NEAR(std::get<igtl::Picture>(*d.body).image.pixels[i], luma, 0.51);
  }
}

TEST_F(IgtlProtocol, ImagesThatAFrameCannotHoldAreRefusedByName) {
  const auto why = [&](int slices, int type, int components, std::size_t bytes) {
    const Decoded d =
        decode_one(igtl_pack::image("cam", 8, 8, slices, type, components, std::string(bytes, 'x'), 7));
    return d.body ? std::string("taken") : d.body.error().why;
  };
  EXPECT_EQ(why(1, ::igtl::ImageMessage::TYPE_UINT16, 1, 128), "uint16; 8-bit grey or colour is read");
  EXPECT_EQ(why(1, ::igtl::ImageMessage::TYPE_FLOAT32, 1, 256), "float32; 8-bit grey or colour is read");
  EXPECT_EQ(why(1, ::igtl::ImageMessage::TYPE_UINT8, 2, 128), "2 components; 1, 3 or 4 are read");
  EXPECT_EQ(why(5, ::igtl::ImageMessage::TYPE_UINT8, 1, 320), "a volume of 5 slices; one is read");
}

TEST_F(IgtlProtocol, PolygonsAndStripsBecomeTriangles) {
  auto message = ::igtl::PolyDataMessage::New();
  auto points = ::igtl::PolyDataPointArray::New();
  const float corners[6][3] = {{0, 0, 0}, {2, 0, 0}, {2, 3, 0}, {0, 3, 0}, {4, 0, 0}, {4, 3, 0}};
  for (const auto& c : corners) points->AddPoint(const_cast<float*>(c));
  message->SetPoints(points);
  auto polygons = ::igtl::PolyDataCellArray::New();
  igtlUint32 quad[4] = {0, 1, 2, 3};
  polygons->AddCell(4, quad);
  message->SetPolygons(polygons);
  auto strips = ::igtl::PolyDataCellArray::New();
  igtlUint32 strip[4] = {1, 4, 2, 5};
  strips->AddCell(4, strip);
  message->SetTriangleStrips(strips);
  const Decoded d = decode_one(igtl_pack::packed(message, "jaw", 3));
  ASSERT_TRUE(d.body) << d.body.error().line();
  const TriangleMesh& mesh = std::get<TriangleMesh>(*d.body);
  ASSERT_EQ(mesh.triangles.size(), 4u);
  EXPECT_NEAR(surface_area_mm2(mesh), 12, 1e-6);  // 2×3 and 2×3
  for (std::size_t i = 0; i < 4; ++i) EXPECT_GT(face_normal_scaled(mesh, i).z(), 0) << i;
}

TEST_F(IgtlProtocol, StatusSaysWhatIsWrong) {
  const Decoded d = decode_one(igtl_pack::status("Device", 13, "E7", "warming up", 9));
  ASSERT_TRUE(d.body);
  const auto& state = std::get<igtl::State>(*d.body);
  EXPECT_FALSE(state.good());
  EXPECT_EQ(state.subcode, 128);
  EXPECT_EQ(state.name, "E7");
  EXPECT_EQ(state.text, "warming up");
  EXPECT_EQ(igtl::status_name(state.code), "not ready");
}

TEST_F(IgtlProtocol, ExtendedHeaderAndMetadata) {
  const std::string v1 = igtl_pack::transform("T", random_pose(random_).matrix(), 5);
  const std::string v2 =
      igtl_pack::with_extended_header(v1, 4711, {{"TransformStatus", "OUT_OF_VIEW"}, {"k", ""}});
  Framer framer;
  framer.feed(v2);
  const auto item = framer.next();
  ASSERT_TRUE(item);
  const auto content = igtl::content_of(item->header, item->body);
  ASSERT_TRUE(content) << content.error().line();
  EXPECT_EQ(content->message_id, 4711u);
  EXPECT_EQ(content->bytes, v1.substr(igtl::kHeaderBytes));
  EXPECT_EQ(content->metadata.at("TransformStatus"), "OUT_OF_VIEW");
  EXPECT_EQ(content->metadata.size(), 2u);
  // Lengths that do not fit are refused, whatever they are.
  for (std::size_t at = 0; at < 8; ++at) {
    std::string body = item->body;
    body[at] = '\x7f';
    const auto lying = igtl::content_of(item->header, body);
    if (lying) {
      EXPECT_LE(lying->bytes.size(), body.size());
    }
  }
}

/// Whole messages among all that can go wrong between them: each comes out, once, in order, however the bytes
/// are cut; nothing else does.
TEST_F(IgtlProtocol, EveryWholeMessageIsFoundAmongDamage) {
  for (int round = 0; round < 200; ++round) {
    std::string bytes;
    std::vector<std::string> whole;
    int damaged = 0;
    for (int i = 0; i < 30; ++i) {
      std::string message =
          random_.below(4) == 0
              ? igtl_pack::image("cam", Image8(20, 9, static_cast<std::uint8_t>(i)), i + 1)
              : igtl_pack::transform("T" + std::to_string(i), random_pose(random_).matrix(), i + 1);
      switch (random_.below(8)) {
        case 0:  // garbage before it
          bytes += random_bytes(random_, 1 + random_.below(150));
          ++damaged;
          break;
        case 1: {  // a bit of the body flipped
          std::string bad = message;
          bad[igtl::kHeaderBytes +
              random_.below(static_cast<std::uint32_t>(bad.size() - igtl::kHeaderBytes))] ^= 1;
          bytes += bad;
          ++damaged;
          break;
        }
        case 2: {  // a body of 2^63 bytes
          std::string bad = message;
          bad[42] = '\x80';
          bytes += bad;
          ++damaged;
          break;
        }
        case 3:  // half a header, or half a body
          bytes += message.substr(0, 1 + random_.below(static_cast<std::uint32_t>(message.size() - 1)));
          ++damaged;
          break;
        case 4: {  // a length that swallows what follows
          std::string bad = igtl_pack::image("liar", Image8(5, 5), 1);
          bad[48] = '\x01';
          bytes += bad;
          ++damaged;
          break;
        }
        default:
          break;
      }
      bytes += message;
      whole.push_back(std::move(message));
    }
    Framer framer;
    std::size_t found = 0;
    int told = 0;
    const auto drain = [&] {
      while (const auto item = framer.next()) {
        if (item->kind == Item::Kind::kRejected) {
          EXPECT_FALSE(item->reason.empty());
          ++told;
          continue;
        }
        ASSERT_LT(found, whole.size());
        EXPECT_EQ(item->body, whole[found].substr(igtl::kHeaderBytes))
            << "seed " << seed_ << " round " << round;
        ++found;
      }
    };
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t n = std::min<std::size_t>(bytes.size() - at, 1 + random_.below(300));
      framer.feed(std::string_view(bytes).substr(at, n));
      at += n;
      drain();
    }
    framer.finish();
    drain();
    EXPECT_EQ(found, whole.size()) << "seed " << seed_ << " round " << round;
    EXPECT_GE(told, damaged ? 1 : 0);
    EXPECT_EQ(framer.waiting_bytes(), 0u);
  }
}

TEST_F(IgtlProtocol, MemoryFollowsWhatCameNotWhatWasAnnounced) {
  Framer framer(1 << 20);
  std::string header = igtl_pack::image("cam", Image8(4, 4), 1).substr(0, igtl::kHeaderBytes);
  framer.feed(header);
  EXPECT_FALSE(framer.next());
  header[45] = 1;  // 2^32 bytes and more
  Framer lied(1 << 20);
  lied.feed(header);
  EXPECT_FALSE(lied.next());
  EXPECT_LT(lied.waiting_bytes(), igtl::kHeaderBytes);  // it does not wait for them
}

/// A picture on a slow line is waited for; one that another message overtakes is not.
TEST_F(IgtlProtocol, AnIncompleteMessageIsGivenUpOnlyForAWholeOne) {
  Image8 picture(300, 200);
  for (auto& p : picture.pixels) p = static_cast<std::uint8_t>(random_.below(256));
  const std::string slow = igtl_pack::image("cam", picture, 1);
  const std::string pose = igtl_pack::transform("T", random_pose(random_).matrix(), 5);
  const std::size_t cut = 100 + random_.below(50'000);
  Framer framer;
  framer.feed(slow.substr(0, cut));
  EXPECT_FALSE(framer.next());
  EXPECT_FALSE(framer.give_up_if_overtaken());
  framer.feed(slow.substr(cut));
  EXPECT_EQ(framer.next()->header.device, "cam");

  framer.feed(slow.substr(0, cut) + pose.substr(0, 100));
  EXPECT_FALSE(framer.next());
  EXPECT_FALSE(framer.give_up_if_overtaken());  // the pose is not whole either
  framer.feed(pose.substr(100) + pose);
  EXPECT_FALSE(framer.next());
  const auto given_up = framer.give_up_if_overtaken();
  ASSERT_TRUE(given_up);
  EXPECT_EQ(given_up->kind, Item::Kind::kRejected);
  EXPECT_EQ(given_up->header.device, "cam");
  EXPECT_NE(given_up->reason.find("after " + std::to_string(cut) + " another"), std::string::npos);
  for (int i = 0; i < 2; ++i) {
    const auto item = framer.next();
    ASSERT_TRUE(item);
    EXPECT_EQ(item->kind, Item::Kind::kMessage);
    EXPECT_EQ(item->body, pose.substr(igtl::kHeaderBytes));
  }
  EXPECT_FALSE(framer.next());
  EXPECT_EQ(framer.waiting_bytes(), 0u);
}

/// Headers in every place, none of which holds: the work stays in proportion to the bytes.
TEST_F(IgtlProtocol, AFloodOfFalseHeadersEnds) {
  constexpr std::uint64_t kMost = 1 << 20;
  std::string header = igtl_pack::image("cam", Image8(4, 4), 1).substr(0, igtl::kHeaderBytes);
  std::string length;
  igtl::append_big_endian(length, kMost / 2, 8);
  header.replace(42, 8, length);
  Framer framer(kMost);
  std::size_t items = 0;
  for (int i = 0; i < 40'000; ++i) {
    framer.feed(header);
    while (framer.next()) ++items;
    ASSERT_LT(framer.waiting_bytes(), 2 * kMost);
  }
  const std::string good = igtl_pack::transform("T", Matrix4::Identity(), 5);
  framer.feed(good);
  framer.finish();
  bool found = false;
  while (const auto item = framer.next()) found |= item->kind == Item::Kind::kMessage;
  EXPECT_GT(items, 0u);
  EXPECT_TRUE(found);
}

}  // namespace
}  // namespace gnathion
