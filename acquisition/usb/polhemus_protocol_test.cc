#include "acquisition/usb/polhemus_protocol.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"

namespace gnathion {
namespace {

PolhemusPose pose_of(std::uint32_t frame, Random& random) {
  PolhemusPose p;
  p.station = 1 + static_cast<int>(frame % 4);
  p.frame = frame;
  p.time_ms = frame * 4;
  p.distortion = -3;
  for (float& x : p.position_cm) x = static_cast<float>(random.uniform(-60, 60));
  double norm = 0;
  for (float& q : p.quaternion) {
    q = static_cast<float>(random.normal());
    norm += static_cast<double>(q) * static_cast<double>(q);
  }
  for (float& q : p.quaternion) q = static_cast<float>(static_cast<double>(q) / std::sqrt(norm));
  return p;
}

bool equal(const PolhemusPose& a, const PolhemusPose& b, bool distortion) {
  bool same = a.station == b.station && a.error == b.error && a.time_ms == b.time_ms && a.frame == b.frame &&
              (!distortion || a.distortion == b.distortion);
  for (int i = 0; i < 3; ++i) same = same && a.position_cm[i] == b.position_cm[i];
  for (int i = 0; i < 4; ++i) same = same && a.quaternion[i] == b.quaternion[i];
  return same;
}

struct Decoded {
  std::vector<PolhemusPose> poses;
  std::vector<PolhemusReply> replies;
  std::size_t garbage = 0;
};
Decoded decode(const std::string& bytes, std::size_t piece, PolhemusFormat format = {}) {
  PolhemusDecoder decoder(format);
  std::vector<PolhemusRecord> records;
  for (std::size_t at = 0; at < bytes.size(); at += piece) decoder.feed(bytes.substr(at, piece), records);
  decoder.flush(records);
  Decoded d;
  for (const PolhemusRecord& r : records) {
    if (const auto* p = std::get_if<PolhemusPose>(&r)) d.poses.push_back(*p);
    if (const auto* p = std::get_if<PolhemusReply>(&r)) d.replies.push_back(*p);
    if (const auto* g = std::get_if<PolhemusGarbage>(&r)) d.garbage += g->bytes;
  }
  return d;
}

/// The layout of a record, byte by byte, as the manuals' tables have it.
TEST(PolhemusProtocol, ReadsTheBytesOfTheManual) {
  const unsigned char bytes[] = {
      'L',  'Y',  2,    'C',  0,    0,    36,   0,                                 // header
      0x10, 0x27, 0,    0,    0x01, 0x02, 0,    0,                                 // 10000 ms, frame 513
      0,    0,    0x20, 0x41, 0,    0,    0x80, 0xbf, 0, 0, 0, 0x3f,               // 10, −1, 0.5
      0,    0,    0,    0,    0,    0,    0x80, 0x3f, 0, 0, 0, 0,    0, 0, 0, 0};  // x axis, half a turn
  const Decoded d = decode(std::string(reinterpret_cast<const char*>(bytes), sizeof bytes), 100);
  ASSERT_EQ(d.poses.size(), 1u);
  EXPECT_EQ(d.garbage, 0u);
  const PolhemusPose& p = d.poses[0];
  EXPECT_EQ(p.station, 2);
  EXPECT_EQ(p.time_ms, 10000u);
  EXPECT_EQ(p.frame, 513u);
  EXPECT_EQ(p.position_cm[0], 10.f);
  EXPECT_EQ(p.position_cm[1], -1.f);
  EXPECT_EQ(p.position_cm[2], 0.5f);
  EXPECT_EQ(p.quaternion[0], 0.f);
  EXPECT_EQ(p.quaternion[1], 1.f);
}

TEST(PolhemusProtocol, WhatIsWrittenIsReadForAnyCut) {
  Random random(11);
  for (const bool distortion : {false, true})
    for (const std::size_t piece : {1u, 7u, 44u, 45u, 512u}) {
      std::string bytes;
      std::vector<PolhemusPose> truth;
      for (std::uint32_t n = 0; n < 200; ++n) {
        truth.push_back(pose_of(n, random));
        bytes += encode(truth.back(), {distortion}, n % 2 ? "PA" : "LY");
      }
      const Decoded d = decode(bytes, piece, {distortion});
      ASSERT_EQ(d.poses.size(), truth.size());
      EXPECT_EQ(d.garbage, 0u);
      for (std::size_t i = 0; i < truth.size(); ++i)
        ASSERT_TRUE(equal(d.poses[i], truth[i], distortion)) << i;
    }
}

/// Whatever is inserted, cut out or overwritten: every record whose bytes are all there comes, none is made
/// up, and no byte is unaccounted for.
TEST(PolhemusProtocol, FindsEveryWholeRecordBetweenDamage) {
  Random random(12);
  int records = 0, found = 0;
  for (int run = 0; run < 300; ++run) {
    std::string bytes;
    std::vector<PolhemusPose> whole;
    bool end_lost = false;
    for (std::uint32_t n = 0; n < 40; ++n) {
      const PolhemusPose pose = pose_of(n, random);
      std::string record = encode(pose, {});
      const std::uint32_t damage = random.below(6);
      switch (end_lost && damage > 0 ? 5 : damage) {
        case 0:  // the end is lost
          record.resize(random.below(static_cast<std::uint32_t>(record.size())));
          break;
        case 1:  // the start is lost
          record.erase(0, 1 + random.below(static_cast<std::uint32_t>(record.size() - 1)));
          break;
        case 2:  // noise before
          for (std::uint32_t i = random.below(60); i > 0; --i) bytes += static_cast<char>(random.below(256));
          [[fallthrough]];
        default:
          whole.push_back(pose);
      }
      end_lost = damage == 0;
      bytes += record;
    }
    const Decoded d = decode(bytes, 1 + random.below(700));
    std::size_t at = 0;
    for (const PolhemusPose& p : d.poses) {
      if (!is_plausible(p)) continue;
      ++found;
      while (at < whole.size() && !equal(whole[at], p, false)) ++at;
      ASSERT_LT(at, whole.size()) << "a record that was never sent";
      ++at;
    }
    records += static_cast<int>(whole.size());
    std::size_t answers = 0;  // damage can look like one
    for (const PolhemusReply& r : d.replies) answers += 8 + r.body.size();
    ASSERT_EQ(d.poses.size() * 44 + answers + d.garbage, bytes.size());
  }
  EXPECT_EQ(found, records);
}

TEST(PolhemusProtocol, AnswersComeBetweenRecords) {
  Random random(13);
  const PolhemusReply stations{0, 0x15, 0, std::string("\x03\0\x01\0", 4)};
  const std::string bytes =
      encode(pose_of(1, random), {}) + encode(stations) + encode(pose_of(2, random), {});
  const Decoded d = decode(bytes, 9);
  EXPECT_EQ(d.poses.size(), 2u);
  ASSERT_EQ(d.replies.size(), 1u);
  EXPECT_EQ(d.replies[0].command, 0x15);
  EXPECT_EQ(d.replies[0].body, stations.body);
  EXPECT_EQ(d.garbage, 0u);
}

TEST(PolhemusProtocol, AnImplausibleRecordIsKeptWhereTheStreamIsSound) {
  Random random(14);
  PolhemusPose bad = pose_of(1, random);
  bad.quaternion[2] = 40;
  const Decoded d = decode(encode(bad, {}) + encode(pose_of(2, random), {}), 1000);
  ASSERT_EQ(d.poses.size(), 2u);
  EXPECT_FALSE(is_plausible(d.poses[0]));
  EXPECT_TRUE(is_plausible(d.poses[1]));
}

TEST(PolhemusProtocol, EndlessGarbageIsToldInPieces) {
  PolhemusDecoder decoder;
  std::vector<PolhemusRecord> records;
  for (int i = 0; i < 100; ++i) decoder.feed(std::string(1000, 'L'), records);
  EXPECT_GE(records.size(), 24u);
}

/// Against the true time of each frame, which the stamps have rounded down to whole milliseconds.
TEST(PolhemusFrameTimer, IsFarFinerThanTheStamps) {
  for (const double rate : {60.0, 120.0, 240.0}) {
    PolhemusFrameTimer timer(rate);
    const double start_ms = 1234.567;
    std::int64_t last = 0;
    for (std::uint32_t n = 5000; n < 15000; ++n) {
      if (n % 17 == 3) continue;  // lost ones do not matter
      const double true_ms = start_ms + n * 1000.0 / rate;
      const std::int64_t ns = timer.time_ns(static_cast<std::uint32_t>(std::floor(true_ms)), n);
      ASSERT_GT(ns, last);
      last = ns;
      const double error_ms = static_cast<double>(ns) * 1e-6 - true_ms;
      ASSERT_LT(std::abs(error_ms), n > 6000 ? 0.25 : 0.51) << rate << " Hz, frame " << n;
    }
    EXPECT_TRUE(timer.rate_holds());
  }
}

TEST(PolhemusFrameTimer, FallsBackToTheStampsWhereTheRateIsWrong) {
  PolhemusFrameTimer timer(240);
  double worst = 0;
  for (std::uint32_t n = 0; n < 1000; ++n) {
    const double true_ms = n * 1000.0 / 120;
    const std::int64_t ns = timer.time_ns(static_cast<std::uint32_t>(std::floor(true_ms)), n);
    worst = std::max(worst, std::abs(static_cast<double>(ns) * 1e-6 - true_ms));
  }
  EXPECT_FALSE(timer.rate_holds());
  EXPECT_LT(worst, 1.01);
}

}  // namespace
}  // namespace gnathion
