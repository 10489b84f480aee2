// Polhemus trackers through the real libusb: everything that a cable and a tracker can do to the driver.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>

#include "acquisition/recording.h"
#include "acquisition/usb/polhemus_device.h"
#include "acquisition/usb/transport.h"
#include "tests/support/mock_tracker.h"
#include "tests/support/pull.h"

namespace gnathion {
namespace {

using mock::Tracker;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

mock::Bed& bed() {
  static mock::Bed the_bed;
  return the_bed;
}

DeviceConfig configured(std::map<std::string, ConfigValue> settings = {}) {
  return {"polhemus", "bow", std::move(settings), "devices.toml: bow", {}};
}

std::function<bool(const PoseSample&)> any_pose() {
  return [](const PoseSample&) { return true; };
}
std::function<bool(const EventSample&)> state(bool back) {
  return [back](const EventSample& e) { return e.header.stream == "bow/state" && e.pressed == back; };
}
std::function<bool(const LedgerSample&)> line(LedgerSample::Fate fate, const std::string& reason) {
  return [fate, reason](const LedgerSample& l) { return l.fate == fate && l.reason.rfind(reason, 0) == 0; };
}
std::function<bool(const TransferSample&)> ended(TransferStatus status) {
  return [status](const TransferSample& t) { return t.status == status; };
}
constexpr auto kRejected = LedgerSample::Fate::kRejected;
constexpr auto kMissing = LedgerSample::Fate::kMissing;

/// Frame counters of one sensor, in the order of delivery.
std::vector<std::uint32_t> frames_of(const std::vector<Sample>& samples, const std::string& stream) {
  std::vector<std::uint32_t> frames;
  for (const PoseSample& p : Pull::all<PoseSample>(samples))
    if (p.header.stream == stream) frames.push_back(p.header.sequence);
  return frames;
}
std::vector<std::uint32_t> range(std::uint32_t first, std::uint32_t last) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t n = first; n <= last; ++n) all.push_back(n);
  return all;
}

class PolhemusTest : public ::testing::Test {
 protected:
  void open(std::map<std::string, ConfigValue> settings = {}) {
    auto opened = open_polhemus(configured(std::move(settings)), clock_);
    ASSERT_TRUE(opened) << opened.error().line();
    device_ = std::move(*opened);
    pull_ = std::make_unique<Pull>(*device_);
  }
  /// The tracker sends only what the test pushes, from frame 1000 on.
  void open_by_hand() {
    tracker_.runs = false;
    tracker_.usb.plug();
    open({{"longest_silence_ms", std::int64_t{60000}}});
    ASSERT_TRUE(wait_for([&] { return tracker_.streaming(); }));
  }
  static bool wait_for(const std::function<bool()>& what) {
    for (int i = 0; i < 30000 && !what(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return what();
  }
  bool frame_came(std::uint32_t n) {
    return pull_->wait([&](const Pull::Samples& s) {
      return Pull::count<PoseSample>(s, [n](const PoseSample& p) { return p.header.sequence == n; }) >= 2;
    });
  }
  std::string refusal(std::map<std::string, ConfigValue> settings = {}) {
    const auto opened = open_polhemus(configured(std::move(settings)), clock_);
    return opened ? "opened" : opened.error().line();
  }

  SystemClock clock_;
  Tracker tracker_{bed(), {}};
  std::unique_ptr<Device> device_;
  std::unique_ptr<Pull> pull_;
};

TEST_F(PolhemusTest, DeliversTruePosesOfEverySensorInMillimetres) {
  tracker_.usb.plug();
  open();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(400, any_pose()));
  const auto samples = pull_->stop();
  ASSERT_EQ(pull_->error(), "");
  for (const PoseSample& p : Pull::all<PoseSample>(samples)) {
    const int station = p.header.stream == "bow/1" ? 1 : 2;
    const double angle = Tracker::angle_rad(station, p.header.sequence);
    ASSERT_EQ(p.header.stream, station == 1 ? "bow/1" : "bow/2");
    ASSERT_EQ(p.body, station == 1 ? "sensor_1" : "sensor_2");
    ASSERT_EQ(p.reference, "transmitter");
    ASSERT_TRUE(p.valid) << p.reason;
    const Vector3 position(Tracker::x_mm(station, p.header.sequence), -50, 20);
    ASSERT_LT((p.reference_from_body.translation_mm - position).norm(), 1e-4);  // floats in cm
    Matrix3 rotation;
    rotation << std::cos(angle), -std::sin(angle), 0, std::sin(angle), std::cos(angle), 0, 0, 0, 1;
    ASSERT_LT((p.reference_from_body.rotation - rotation).norm(), 1e-6);
  }
  const auto first = frames_of(samples, "bow/1");
  EXPECT_EQ(first, range(first.front(), first.back()));
  EXPECT_EQ(frames_of(samples, "bow/2"), first);
  EXPECT_EQ(tracker_.usb.written().back(), "P");  // left quiet
  EXPECT_THAT(device_->description().settings, Contains("sensors: 1, 2"));
  EXPECT_EQ(device_->description().vendor, "Polhemus");
  EXPECT_EQ(device_->health().state, DeviceState::kStopped);
  EXPECT_EQ(device_->health().received, first.size() * 2);
}

TEST_F(PolhemusTest, SaysWhatItSet) {
  tracker_.usb.plug();
  open({{"hemisphere", std::vector<double>{0, 0, 1}},
        {"alignment_mm", std::vector<double>{0, 0, 0, 100, 0, 0, 0, 100, 0}}});
  ASSERT_TRUE(pull_->wait_more<PoseSample>(2, any_pose()));
  EXPECT_THAT(tracker_.usb.written(),
              ElementsAre("P", "F1\r", "U1\r", "O*,8,9,2,7\r", "\x12*\r", "\x02*\r", "H*,0,0,1\r",
                          "A*,0.0000,0.0000,0.0000,10.0000,0.0000,0.0000,0.0000,10.0000,0.0000\r",
                          "X0,1,0,0\r", "Y0,1,0,0\r",
                          "\x15"
                          "0\r",
                          "C\r"));
}

TEST_F(PolhemusTest, ComesBackFromAHundredReplugsAndLosesNothingOlder) {
  tracker_.usb.plug();
  open();
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose())) << i << ": " << device_->health().message;
    tracker_.usb.unplug();
    ASSERT_TRUE(pull_->wait([&](const Pull::Samples& s) {
      return Pull::count<EventSample>(s, state(false)) == static_cast<std::size_t>(i + 1);
    })) << i;
    tracker_.power_cycle();
    tracker_.usb.plug();
  }
  ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
  const auto samples = pull_->stop();
  EXPECT_EQ(Pull::count<EventSample>(samples, state(true)), 100u);
  EXPECT_EQ(device_->health().reconnects, 100u);
  EXPECT_EQ(Pull::count<TransferSample>(samples, ended(kTransferGone)), 100u);  // each told once
  EXPECT_EQ(device_->health().rejected, 0u);
  for (const char* stream : {"bow/1", "bow/2"}) {  // every frame that the tracker gave away has arrived
    const auto frames = frames_of(samples, stream);
    EXPECT_EQ(frames, range(1000, frames.back())) << stream;
  }
}

TEST_F(PolhemusTest, FramesWhileItWasAwayAreCounted) {
  tracker_.usb.plug();
  open();
  std::uint32_t away = 0;
  for (std::uint32_t i = 1; i <= 5; ++i) {
    ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
    tracker_.usb.unplug();
    ASSERT_TRUE(
        pull_->wait([&](const Pull::Samples& s) { return Pull::count<EventSample>(s, state(false)) == i; }));
    tracker_.next_frame += 10 * i;
    away += 10 * i;
    tracker_.usb.plug();
    ASSERT_TRUE(
        pull_->wait([&](const Pull::Samples& s) { return Pull::count<EventSample>(s, state(true)) == i; }));
  }
  ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
  pull_->stop();
  EXPECT_EQ(device_->health().missing, 2 * away);  // two sensors
}

TEST_F(PolhemusTest, ACounterThatStartsAnewIsNoDisorder) {
  tracker_.usb.plug();
  open();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(200, any_pose()));
  tracker_.usb.unplug();
  ASSERT_TRUE(
      pull_->wait([&](const Pull::Samples& s) { return Pull::count<EventSample>(s, state(false)) == 1; }));
  tracker_.power_cycle();
  tracker_.next_frame = 900;  // little less than before
  tracker_.usb.plug();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(20, any_pose()));
  tracker_.next_frame = 7;  // and once more with the cable in
  ASSERT_TRUE(frame_came(20));
  const auto samples = pull_->stop();
  EXPECT_EQ(device_->health().rejected, 0u);
  EXPECT_EQ(device_->health().missing, 0u);
  HostTime last{0};
  for (const PoseSample& p : Pull::all<PoseSample>(samples))
    if (p.header.stream == "bow/1") {
      ASSERT_GT(p.header.capture, last);
      last = p.header.capture;
    }
}

TEST_F(PolhemusTest, StallIsClearedAndTold) {
  open_by_hand();
  tracker_.usb.push(tracker_.frame(1000));
  tracker_.usb.push("", -EPIPE);
  tracker_.usb.push(tracker_.frame(1001));
  tracker_.usb.push("", -EPIPE);
  tracker_.usb.push(tracker_.frame(1002));
  ASSERT_TRUE(frame_came(1002));
  EXPECT_GE(tracker_.usb.halts_cleared(), 1);
  const auto samples = pull_->stop();
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "stall")), 2u);
  EXPECT_EQ(frames_of(samples, "bow/1"), range(1000, 1002));
}

TEST_F(PolhemusTest, RecordsCutAnywhereAreJoined) {
  open_by_hand();
  std::string all;
  for (std::uint32_t n = 1000; n < 1100; ++n) all += tracker_.frame(n);
  for (std::size_t at = 0, piece = 1; at < all.size(); at += piece, piece = piece * 7 % 97 + 1)
    tracker_.usb.push(all.substr(at, piece));
  ASSERT_TRUE(frame_came(1099));
  const auto samples = pull_->stop();
  EXPECT_EQ(frames_of(samples, "bow/1"), range(1000, 1099));
  EXPECT_EQ(frames_of(samples, "bow/2"), range(1000, 1099));
  EXPECT_EQ(device_->health().rejected + device_->health().missing, 0u);
}

TEST_F(PolhemusTest, ShortReadCostsOneRecordAndIsTold) {
  open_by_hand();
  const std::string frame = tracker_.frame(1001);
  tracker_.usb.push(tracker_.frame(1000));
  tracker_.usb.push(frame.substr(0, 30));  // 14 bytes of the first sensor's record never come
  tracker_.usb.push(frame.substr(44));
  tracker_.usb.push(tracker_.frame(1002));
  ASSERT_TRUE(frame_came(1002));
  const auto samples = pull_->stop();
  EXPECT_THAT(frames_of(samples, "bow/1"), ElementsAre(1000, 1002));
  EXPECT_EQ(frames_of(samples, "bow/2"), range(1000, 1002));
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "garbage: 30 bytes")), 1u);
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kMissing, "counter gap")), 1u);
}

TEST_F(PolhemusTest, GarbageIsPassedOverAndMeasured) {
  open_by_hand();
  std::string noise;
  for (int i = 0; i < 777; ++i) noise += static_cast<char>(i * 131 % 256);
  tracker_.usb.push(tracker_.frame(1000) + noise + tracker_.frame(1001));
  tracker_.usb.push(noise);
  tracker_.usb.push(tracker_.frame(1002));
  ASSERT_TRUE(frame_came(1002));
  const auto samples = pull_->stop();
  EXPECT_EQ(frames_of(samples, "bow/1"), range(1000, 1002));
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "garbage: 777 bytes")), 2u);
}

TEST_F(PolhemusTest, DuplicatesAndReorderedCountersAreLeftOutAndTold) {
  open_by_hand();
  for (const std::uint32_t n : {1000, 1001, 1001, 1004, 1003, 1005}) tracker_.usb.push(tracker_.frame(n));
  ASSERT_TRUE(frame_came(1005));
  const auto samples = pull_->stop();
  EXPECT_THAT(frames_of(samples, "bow/1"), ElementsAre(1000, 1001, 1004, 1005));
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "duplicate")), 2u);  // one a sensor
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "out of order: frame 1003 after 1004")), 2u);
  const auto lines = Pull::all<LedgerSample>(samples);
  const auto gap = std::find_if(lines.begin(), lines.end(), line(kMissing, "counter gap"));
  ASSERT_NE(gap, lines.end());
  EXPECT_EQ(gap->header.sequence, 1002u);
  EXPECT_EQ(gap->count, 2u);
}

TEST_F(PolhemusTest, BabbleIsToldAndItsBytesAreUsed) {
  open_by_hand();
  tracker_.usb.push(tracker_.frame(1000));
  tracker_.usb.push(tracker_.frame(1001) + "LYgarbage", -EOVERFLOW);
  tracker_.usb.push(tracker_.frame(1002));
  ASSERT_TRUE(frame_came(1002));
  const auto samples = pull_->stop();
  EXPECT_EQ(frames_of(samples, "bow/1"), range(1000, 1002));
  EXPECT_EQ(Pull::count<LedgerSample>(samples, line(kRejected, "babble")), 1u);
}

TEST_F(PolhemusTest, AnEndpointThatOnlyFailsIsOpenedAnew) {
  open_by_hand();
  tracker_.usb.push(tracker_.frame(1000));
  for (int i = 0; i < 40; ++i) tracker_.usb.push("", -EPROTO);
  ASSERT_TRUE(
      pull_->wait([](const Pull::Samples& s) { return Pull::count<EventSample>(s, state(true)) == 1; }));
  ASSERT_TRUE(wait_for([&] { return tracker_.streaming(); }));
  tracker_.usb.push(tracker_.frame(1001));
  ASSERT_TRUE(frame_came(1001));
  const auto samples = pull_->stop();
  EXPECT_GE(Pull::count<LedgerSample>(samples, line(kRejected, "i/o error")), 16u);
  EXPECT_EQ(frames_of(samples, "bow/1"), range(1000, 1001));
}

TEST_F(PolhemusTest, UnpluggedWhileItIsSetUpItComesBackLater) {
  tracker_.usb.plug();
  open();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
  tracker_.answers = false;
  for (int i = 0; i < 3; ++i) {
    tracker_.usb.unplug();
    tracker_.power_cycle();
    const std::size_t before = tracker_.usb.written().size();
    ASSERT_TRUE(
        wait_for([&] { return device_->health().message.find("none is connected") != std::string::npos; }));
    tracker_.usb.plug();
    ASSERT_TRUE(wait_for([&] {  // it is asked for its sensors
      const auto written = tracker_.usb.written();
      return written.size() > before && written.back()[0] == 0x15;
    }));
  }
  tracker_.usb.unplug();
  tracker_.answers = true;
  tracker_.usb.plug();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
  const auto samples = pull_->stop();
  EXPECT_LE(Pull::count<TransferSample>(samples, ended(kTransferGone)), 4u);  // one an unplugging
  EXPECT_EQ(Pull::count<EventSample>(samples, state(false)), 1u);
  EXPECT_EQ(Pull::count<EventSample>(samples, state(true)), 1u);  // only what works is told
}

TEST_F(PolhemusTest, AnEndpointThatStallsWhileTheTrackerIsSetUpIsGivenUp) {
  tracker_.answers = false;
  tracker_.usb.on_write = [this, obey = tracker_.usb.on_write](const std::string& bytes) {
    obey(bytes);
    if (bytes[0] == 0x15)
      for (int i = 0; i < 5000; ++i) tracker_.usb.push("", -EPIPE);
  };
  tracker_.usb.plug();
  EXPECT_THAT(refusal(), HasSubstr("it does not answer"));
  EXPECT_GE(tracker_.usb.halts_cleared(), 10);
  EXPECT_LE(tracker_.usb.halts_cleared(), 20);
}

TEST_F(PolhemusTest, LossIsToldThoughOnlyErrorsShowItAndReturnOnceItWorks) {
  open_by_hand();
  tracker_.usb.fail_claim(EBUSY);  // no return meanwhile
  for (int i = 0; i < 40; ++i) tracker_.usb.push("", -EPROTO);
  ASSERT_TRUE(
      pull_->wait([](const Pull::Samples& s) { return Pull::count<EventSample>(s, state(false)) == 1; }));
  tracker_.usb.unplug();
  tracker_.power_cycle();
  tracker_.sensors_connected = false;
  tracker_.usb.fail_claim(0);
  tracker_.usb.plug();
  ASSERT_TRUE(wait_for([&] { return device_->health().message.find("no sensor") != std::string::npos; }));
  tracker_.usb.unplug();
  tracker_.sensors_connected = tracker_.runs = true;
  tracker_.usb.plug();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(6, any_pose()));
  const auto samples = pull_->stop();
  EXPECT_EQ(Pull::count<EventSample>(samples, state(false)), 1u);
  EXPECT_EQ(Pull::count<EventSample>(samples, state(true)), 1u);
  EXPECT_EQ(device_->health().reconnects, 1u);
}

TEST_F(PolhemusTest, ASilentTrackerIsStartedAgain) {
  tracker_.usb.plug();
  open({{"longest_silence_ms", std::int64_t{500}}});
  for (int i = 1; i <= 3; ++i) {
    ASSERT_TRUE(pull_->wait_more<PoseSample>(4, any_pose())) << i;
    tracker_.fall_silent();
    ASSERT_TRUE(pull_->wait([&](const Pull::Samples& s) {
      return Pull::count<LedgerSample>(s, line(kRejected, "timeout")) >= static_cast<std::size_t>(i);
    })) << i;
  }
  ASSERT_TRUE(pull_->wait_more<PoseSample>(4, any_pose()));
  const auto samples = pull_->stop();
  const auto frames = frames_of(samples, "bow/1");
  EXPECT_EQ(frames, range(1000, frames.back()));
  EXPECT_GE(tracker_.starts, 4);
}

TEST_F(PolhemusTest, ErrorsOfTheTrackerMakePosesInvalidByName) {
  open_by_hand();
  PolhemusPose bad = tracker_.pose(1, 1000), torn = tracker_.pose(2, 1000);
  bad.error = 'c';
  torn.quaternion[0] = 0.5f;
  tracker_.usb.push(encode(bad, {}) + encode(torn, {}) + tracker_.frame(1001));
  ASSERT_TRUE(frame_came(1001));
  const auto poses = Pull::all<PoseSample>(pull_->stop());
  EXPECT_FALSE(poses[0].valid);
  EXPECT_EQ(poses[0].reason, "source failed in xy");
  EXPECT_FALSE(poses[1].valid);
  EXPECT_EQ(poses[1].reason, "not a position and a unit quaternion");
  EXPECT_TRUE(poses[2].valid);
}

TEST_F(PolhemusTest, RawTransfersReplayBitForBit) {
  open_by_hand();
  tracker_.usb.push(tracker_.frame(1000).substr(0, 61));
  tracker_.usb.push("", -EPIPE);
  tracker_.usb.push(tracker_.frame(1000).substr(61) + "noise" + tracker_.frame(1001));
  tracker_.usb.push(tracker_.frame(1004) + tracker_.frame(1003), -EOVERFLOW);
  tracker_.usb.push(tracker_.frame(1004));
  tracker_.runs = true;
  tracker_.next_frame = 1005;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(pull_->wait_more<PoseSample>(20, any_pose()));
    tracker_.usb.unplug();
    ASSERT_TRUE(pull_->wait([&](const Pull::Samples& s) {
      return Pull::count<EventSample>(s, state(false)) == static_cast<std::size_t>(i + 1);
    }));
    tracker_.power_cycle();
    tracker_.usb.plug();
  }
  ASSERT_TRUE(pull_->wait_more<PoseSample>(20, any_pose()));
  const auto live = pull_->stop();
  std::vector<Sample> raw;
  for (const Sample& s : live)
    if (std::holds_alternative<TransferSample>(s)) raw.push_back(s);
  EXPECT_GE(Pull::count<LedgerSample>(live, [](const LedgerSample&) { return true; }), 5u);
  auto replay = replay_polhemus(configured(), std::make_unique<VectorSource>(raw));
  ASSERT_TRUE(replay);
  Pull again(**replay);
  ASSERT_TRUE(again.wait([&](const Pull::Samples& s) { return s.size() >= live.size(); }));
  expect_same_samples(live, again.stop());

  // and through a file, as a field failure comes
  const auto file = std::filesystem::temp_directory_path() / fmt::format("gnathion_bow_{}.mcap", ::getpid());
  auto recording = RecordingWriter::create(file);
  ASSERT_TRUE(recording);
  for (const Sample& s : live) ASSERT_TRUE(recording->write(s));
  ASSERT_TRUE(recording->finish());
  auto filed = open_polhemus(configured({{"replay", file.string()}}), clock_);
  ASSERT_TRUE(filed) << filed.error().line();
  Pull from_file(**filed);
  ASSERT_TRUE(from_file.wait([&](const Pull::Samples& s) { return s.size() >= live.size(); }));
  expect_same_samples(live, from_file.stop());
  std::filesystem::remove(file);
}

TEST_F(PolhemusTest, RefusesDescriptorsThatLieByName) {
  struct Lie {
    std::function<void(mock::UsbSpec&)> tell;
    std::string refusal;
  };
  const std::vector<Lie> lies = {
      {[](auto& s) { s.endpoints = 0; }, "no bulk endpoint to read from"},
      {[](auto& s) { s.endpoints = 1; }, "no bulk endpoint to read from"},
      {[](auto& s) { s.in_attributes = 3; }, "no bulk endpoint to read from (0x88 is interrupt)"},
      {[](auto& s) { s.out_attributes = 1; }, "no bulk endpoint to write to (0x04 is isochronous)"},
      {[](auto& s) { s.packet = 0; }, "claims packets of 0 bytes"},
      {[](auto& s) { s.in = 0x08; }, "no bulk endpoint to read from"},
      {[](auto& s) { s.configuration = std::string("\x09\x02\x09\x00\x00\x01\x00\x80\x32", 9); },
       "names no interface"},
      {[](auto& s) { s.configuration = std::string("\x09\x02\xff\x00\x01\x01\x00\x80\x32", 9); },
       "descriptor"},
      {[](auto& s) {
         s.configuration = std::string("\x09\x02\x12\x00\x01\x01\x00\x80\x32\x00\x04\x00\x00\x02", 14);
       },
       "descriptor"},
  };
  for (const Lie& lie : lies) {
    mock::UsbSpec spec;
    lie.tell(spec);
    Tracker liar(bed(), spec);
    liar.usb.plug();
    EXPECT_THAT(refusal(), HasSubstr(lie.refusal));
    EXPECT_THAT(refusal(), HasSubstr("cannot open Polhemus tracker: devices.toml: bow: "));
  }
}

TEST_F(PolhemusTest, RefusesBadInputWithOneLine) {
  EXPECT_EQ(refusal(), "cannot open Polhemus tracker: devices.toml: bow: none is connected");
  EXPECT_THAT(refusal({{"hemisfere", 1.0}}), HasSubstr("unknown key 'hemisfere'; 'hemisphere' is meant?"));
  EXPECT_THAT(refusal({{"hemisphere", std::vector<double>{1}}}),
              HasSubstr("'hemisphere' must be a direction"));
  EXPECT_THAT(refusal({{"product", std::string("g4")}}), HasSubstr("one of any, patriot, liberty"));
  EXPECT_THAT(refusal({{"rate_hz", 0.0}}), HasSubstr("'rate_hz' is 0"));

  mock::UsbSpec raw;
  raw.product = 0xff21;
  {
    mock::Usb unloaded(bed(), raw);
    unloaded.plug();
    EXPECT_THAT(refusal(), HasSubstr("0f44:ff21 at port 1-1 has no firmware yet"));
  }
  tracker_.usb.plug();
  EXPECT_THAT(refusal({{"serial", std::string("77")}}),
              HasSubstr("none with serial 77; there is LIBERTY at port 1-1"));
  EXPECT_THAT(refusal({{"product", std::string("patriot")}}), HasSubstr("none is connected"));
  tracker_.usb.fail_claim(EBUSY);
  EXPECT_THAT(refusal(), HasSubstr("is in use by another program"));
  tracker_.usb.fail_claim(0);
  tracker_.sensors_connected = false;
  EXPECT_THAT(refusal(), HasSubstr("no sensor is connected to it"));
  tracker_.sensors_connected = true;
  tracker_.refuses = 'X';
  EXPECT_THAT(refusal(), HasSubstr("it refuses the command 'X': parameter above limit"));
  tracker_.refuses = 0;
  {
    open();
    ASSERT_TRUE(wait_for([&] { return tracker_.streaming(); }));
    tracker_.deaf = true;
    pull_.reset();
    device_.reset();
    EXPECT_THAT(refusal(), HasSubstr("it does not answer"));  // though it sends without end
    tracker_.deaf = false;
  }
  tracker_.answers = false;
  EXPECT_THAT(refusal(), HasSubstr("it does not answer"));
  tracker_.usb.fail_writes(-EPIPE);
  EXPECT_THAT(refusal(), HasSubstr("it does not take commands"));
}

TEST_F(PolhemusTest, TellsTwoTrackersApart) {
  mock::UsbSpec left, right;
  left.serial = right.serial = "4711";
  right.port = "1-2";
  Tracker a(bed(), left), b(bed(), right);
  a.usb.plug();
  b.usb.plug();
  EXPECT_THAT(refusal(),
              HasSubstr("2 are connected: LIBERTY at port 1-1 with serial 4711, LIBERTY at port 1-2 with "
                        "serial 4711; say which by 'serial' or 'port'"));
  EXPECT_THAT(refusal({{"serial", std::string("4711")}}), HasSubstr("2 have one serial"));
  open({{"serial", std::string("4711")}, {"port", std::string("1-2")}});
  ASSERT_TRUE(pull_->wait_more<PoseSample>(4, any_pose()));
  EXPECT_EQ(device_->description().serial, "4711");
  EXPECT_EQ(a.starts, 0);
  EXPECT_EQ(b.starts, 1);
  pull_.reset();
  device_.reset();  // before the trackers
}

TEST_F(PolhemusTest, NamesTheRuleWhereThereIsNoPermission) {
  tracker_.usb.plug();
  const std::string root = bed().root();
  if (::geteuid() == 0) {  // root may open everything: be nobody for a moment
    namespace fs = std::filesystem;
    constexpr auto kAll = fs::perms::all;
    fs::permissions(root, kAll);
    for (const auto& entry : fs::recursive_directory_iterator(root))
      if (!entry.is_symlink()) fs::permissions(entry.path(), kAll);
    fs::permissions(root + tracker_.usb.node(), fs::perms::none);
    ASSERT_EQ(::seteuid(65534), 0);
  } else {
    std::filesystem::permissions(root + tracker_.usb.node(), std::filesystem::perms::none);
  }
  const std::string said = refusal();
  if (::getuid() == 0) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_THAT(said, HasSubstr("no permission for /dev/bus/usb/001/"));
  EXPECT_THAT(said, HasSubstr("install packaging/udev/70-gnathion.rules to /etc/udev/rules.d"));
}

TEST_F(PolhemusTest, WaitsForATrackerIfAsked) {
  open({{"wait", true}});
  ASSERT_TRUE(
      wait_for([&] { return device_->health().message.find("none is connected") != std::string::npos; }));
  EXPECT_EQ(device_->health().state, DeviceState::kRecovering);
  tracker_.usb.plug();
  ASSERT_TRUE(pull_->wait_more<PoseSample>(4, any_pose()));
  EXPECT_EQ(device_->health().state, DeviceState::kRunning);
}

}  // namespace
}  // namespace gnathion
