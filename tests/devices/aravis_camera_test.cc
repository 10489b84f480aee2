// Kind "aravis" through the real library, against Aravis's own fake camera on loopback.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <future>
#include <thread>

#include "acquisition/camera/aravis_device.h"
#include "acquisition/camera/camera_identity.h"
#include "tests/support/fake_gv_camera.h"

namespace gnathion {
namespace {

using std::chrono::seconds;
using test::FakeGvCamera;
using test::FakeGvPort;
using ::testing::Contains;
using ::testing::HasSubstr;

DeviceConfig config_for(std::map<std::string, ConfigValue> settings) {
  DeviceConfig config;
  config.kind = "aravis";
  config.stream = "camera_0";
  config.where = "devices.toml: camera_0";
  settings.emplace("ip", std::string("127.0.0.1"));
  config.settings = std::move(settings);
  return config;
}

/// The fake camera needs a moment to listen, and one to notice that its last client has gone.
Result<std::unique_ptr<Device>> open_patiently(const DeviceConfig& config, Clock& clock) {
  for (int i = 0;; ++i) {
    auto device = open_aravis_device(config, clock);
    if (device || i == 40) return device;
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
  }
}

/// Everything a device told, counted.
struct Account {
  std::vector<SampleHeader> frames;
  std::vector<LedgerSample> lines;
  std::vector<EventSample> events;
  std::uint64_t rejected = 0, missing = 0, bad_sizes = 0;
  void take(const Sample& sample) {
    if (const auto* frame = std::get_if<FrameSample>(&sample)) {
      frames.push_back(frame->header);
      bad_sizes += frame->image.width_px != 512 || frame->image.height_px != 512 ||
                   frame->image.pixels.size() != 512u * 512u;
    } else if (const auto* line = std::get_if<LedgerSample>(&sample)) {
      lines.push_back(*line);
      (line->fate == LedgerSample::Fate::kMissing ? missing : rejected) += line->count;
    } else if (const auto* event = std::get_if<EventSample>(&sample)) {
      events.push_back(*event);
    }
  }
  /// Takes until `enough`, at most `limit`.
  testing::AssertionResult take_until(Device& device, const std::function<bool()>& enough,
                                      seconds limit = seconds(60)) {
    const auto end = std::chrono::steady_clock::now() + limit;
    while (!enough()) {
      if (std::chrono::steady_clock::now() > end)
        return testing::AssertionFailure() << frames.size() << " frames, " << device.health().message;
      auto pulled = std::async(std::launch::async, [&] { return device.next(); });
      while (pulled.wait_for(seconds(1)) != std::future_status::ready)
        if (std::chrono::steady_clock::now() > end) device.stop();
      auto sample = pulled.get();
      if (!sample) return testing::AssertionFailure() << sample.error().line();
      if (!*sample) return testing::AssertionFailure() << "the device ended";
      take(**sample);
    }
    return testing::AssertionSuccess();
  }
  /// By the camera's own clock.
  double period_s() const {
    return 1e-9 * static_cast<double>(frames.back().device.ns - frames.front().device.ns) /
           (frames.back().sequence - frames.front().sequence);
  }
  /// Every number from 0 on is a frame, or within one line, once.
  void expect_complete() const {
    std::map<std::uint32_t, int> seen;
    for (const auto& h : frames) ++seen[h.sequence];
    for (const auto& line : lines)
      for (std::uint32_t i = 0; i < line.count; ++i) ++seen[line.header.sequence + i];
    ASSERT_FALSE(seen.empty());
    EXPECT_EQ(seen.begin()->first, 0u);
    EXPECT_EQ(seen.rbegin()->first + 1, seen.size());
    for (const auto& [sequence, times] : seen) EXPECT_EQ(times, 1) << sequence;
  }
};

class AravisCamera : public ::testing::Test {
 protected:
  FakeGvPort port_;
  SystemClock clock_;
};

TEST_F(AravisCamera, DeliversFramesWithTimesAndNumbers) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  // Off even where no gain is asked for.
  EXPECT_THAT((*device)->description().settings, Contains("gain_auto: off"));
  Account account;
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= 60; }));
  account.expect_complete();
  EXPECT_EQ(account.bad_sizes, 0u);
  // A busy machine may lose packets even here; nearly all must come, and the rest is accounted for.
  EXPECT_LE(account.rejected + account.missing, 6u);
  for (std::size_t i = 1; i < account.frames.size(); ++i) {
    const SampleHeader &a = account.frames[i - 1], &b = account.frames[i];
    EXPECT_EQ(b.stream, "camera_0");
    EXPECT_GT(b.sequence, a.sequence);
    EXPECT_GT(b.device.ns, a.device.ns);
    EXPECT_GT(b.capture.ns, a.capture.ns);
    EXPECT_LT(b.capture.ns, b.arrival.ns);
  }
  EXPECT_GT(account.period_s(), 0.036);  // 25 Hz; on a busy machine the fake camera is slower than it says
  EXPECT_LT(account.period_s(), 0.4);
  const DeviceHealth health = (*device)->health();
  EXPECT_EQ(health.state, DeviceState::kRunning);
  EXPECT_GE(health.received, 60u);
  EXPECT_GT(health.rate_hz, 5);
  EXPECT_LT(health.rate_hz, 50);
  EXPECT_TRUE(health.clock.known);
  const DeviceDescription d = (*device)->description();
  EXPECT_EQ(d.kind, "aravis");
  EXPECT_EQ(d.serial, "GV01");
  EXPECT_FALSE(d.vendor.empty());
  EXPECT_THAT(d.settings, Contains("pixel_format: Mono8"));
  EXPECT_THAT(d.settings, Contains("trigger: free running"));
  for (const auto& line : d.settings) std::printf("  %s\n", line.c_str());
  std::printf("  drift %.1f ppm, jitter %.3f ms\n", health.clock.drift_ppm, health.clock.jitter_ms);
}

TEST_F(AravisCamera, SetsAndReadsBack) {
  FakeGvCamera camera({"-s", "BOW7"});
  auto device = open_patiently(
      config_for(
          {{"serial", std::string("BOW7")}, {"exposure_us", 8000.0}, {"gain", 2.0}, {"rate_hz", 50.0}}),
      clock_);
  ASSERT_TRUE(device) << device.error().line();
  const DeviceDescription d = (*device)->description();
  EXPECT_EQ(d.serial, "BOW7");
  EXPECT_THAT(d.settings, Contains(HasSubstr("exposure_us: 8000")));
  EXPECT_THAT(d.settings, Contains(HasSubstr("gain: 2")));
  EXPECT_THAT(d.settings, Contains(HasSubstr("rate_hz: 50")));
  for (const auto& line : d.settings) std::printf("  %s\n", line.c_str());
  for (const auto& line : d.warnings) std::printf("  warning: %s\n", line.c_str());
  Account account;
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= 50; }));
  EXPECT_GT(account.period_s(), 0.018);
  EXPECT_LT(account.period_s(), 0.4);
  // The exposure lies before arrival.
  for (const auto& h : account.frames) EXPECT_LE(h.capture.ns, h.arrival.ns - 4'000'000);
}

TEST_F(AravisCamera, RefusesInOneLineWhatTheCameraCannot) {
  FakeGvCamera camera;
  {
    auto works = open_patiently(config_for({}), clock_);
    ASSERT_TRUE(works) << works.error().line();
  }
  const auto why = [&](std::map<std::string, ConfigValue> settings) {
    const auto device = open_aravis_device(config_for(std::move(settings)), clock_);
    EXPECT_FALSE(device);
    if (device) return std::string("opened");
    EXPECT_EQ(exit_code(device.error().code), 4);
    const std::string line = device.error().line();
    EXPECT_EQ(line.find('\n'), std::string::npos);
    std::printf("  %s\n", line.c_str());
    return line;
  };
  EXPECT_THAT(why({{"rate_hz", 100000.0}}), HasSubstr("rate_hz 100000 is impossible: the camera allows "));
  EXPECT_THAT(why({{"exposure_us", 1e9}}),
              HasSubstr("exposure_us 1000000000 is impossible: the camera allows "));
  EXPECT_THAT(why({{"gain", 1e6}}), HasSubstr("gain 1000000 is impossible: the camera allows "));
  EXPECT_THAT(why({{"trigger", std::string("line77")}}),
              HasSubstr("trigger 'line77' is not one of the camera's: "));
  EXPECT_THAT(why({{"serial", std::string("OTHER")}}), HasSubstr("has the serial GV01, not OTHER"));
  EXPECT_THAT(why({{"exposure", 8000.0}}), HasSubstr("unknown key 'exposure'; 'exposure_us' is meant?"));
  EXPECT_THAT(why({{"rate_hz", 200.0}, {"exposure_us", 8000.0}}),
              HasSubstr("an exposure of 8000 us allows 125.0"));
  EXPECT_THAT(why({{"ip", std::string("127.0.0.9")}}), HasSubstr("127.0.0.9"));
  EXPECT_THAT(why({{"pixel_format", std::string("Mono12")}}), HasSubstr("it must be one of Mono8"));
}

TEST_F(AravisCamera, LostPacketsAreRejectedFramesAndEveryNumberIsAccountedFor) {
  // 5 of 1000 packets, of 189 a frame: most frames have a hole, some lose their leader, with it their number
  // and time. The fake camera's numbers start at 65400, so that they wrap on the way.
  FakeGvCamera camera({"-r", "5"});
  auto device = open_patiently(config_for({{"rate_hz", 100.0}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Account account;
  ASSERT_TRUE(account.take_until(**device, [&] {
    return account.rejected >= 10 && account.frames.size() + account.rejected + account.missing >= 300;
  }));
  account.expect_complete();
  EXPECT_EQ(account.bad_sizes, 0u);
  const DeviceHealth health = (*device)->health();
  EXPECT_GE(health.rejected, account.rejected);
  std::map<std::string, std::uint64_t> reasons;
  for (const auto& line : account.lines) reasons[line.reason] += line.count;
  for (const auto& [reason, count] : reasons)
    std::printf("  %s: %llu\n", reason.c_str(), static_cast<unsigned long long>(count));
  std::printf("  accepted %zu, rejected %llu, missing %llu\n", account.frames.size(),
              static_cast<unsigned long long>(account.rejected),
              static_cast<unsigned long long>(account.missing));
  EXPECT_GT(account.frames.size(), 20u);
  EXPECT_LT(account.missing, 20u);
  EXPECT_EQ(reasons.count("packets missing") + reasons.count("not complete in time") > 0, true);
}

TEST_F(AravisCamera, ComesBackAfterThePlugWasPulled) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Account account;
  for (int pull = 1; pull <= 2; ++pull) {
    const std::size_t before = account.frames.size();
    ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= before + 20; }));
    camera.kill();
    ASSERT_TRUE(account.take_until(**device, [&] { return account.events.size() == 2u * pull - 1; }));
    EXPECT_EQ((*device)->health().state, DeviceState::kRecovering);
    camera.start();
    ASSERT_TRUE(account.take_until(**device, [&] { return account.events.size() == 2u * pull; }));
    EXPECT_EQ((*device)->health().reconnects, static_cast<std::uint64_t>(pull));
  }
  const std::size_t before = account.frames.size();
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= before + 20; }));
  account.expect_complete();
  EXPECT_EQ((*device)->health().state, DeviceState::kRunning);
  for (std::size_t i = 0; i < account.events.size(); ++i) {
    const EventSample& e = account.events[i];
    EXPECT_EQ(e.kind, "device");
    EXPECT_EQ(e.header.stream, "camera_0/state");
    EXPECT_EQ(e.pressed, i % 2 == 1);
    EXPECT_EQ(e.header.sequence, i);
    std::printf("  %s\n", e.text.c_str());
  }
  for (std::size_t i = 1; i < account.frames.size(); ++i)
    EXPECT_GT(account.frames[i].capture.ns, account.frames[i - 1].capture.ns);
}

TEST_F(AravisCamera, SurvivesACameraThatFreezes) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Account account;
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= 20; }));
  camera.freeze();
  ASSERT_TRUE(account.take_until(**device, [&] { return account.events.size() == 1; }));
  camera.thaw();
  ASSERT_TRUE(account.take_until(**device, [&] { return account.events.size() == 2; }));
  const std::size_t before = account.frames.size();
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= before + 20; }));
  account.expect_complete();
}

TEST_F(AravisCamera, WhatASlowReaderDoesNotTakeIsInTheLedger) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({{"queue_frames", 4.0}, {"rate_hz", 50.0}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  while ((*device)->health().rejected < 40) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  Account account;
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= 30; }));
  account.expect_complete();
  EXPECT_GE(account.rejected, 40u);
  std::uint64_t full = 0;
  for (const LedgerSample& line : account.lines) full += line.reason == "queue full" ? line.count : 0;
  EXPECT_GE(full, 35u);
  EXPECT_LT(account.lines.size(), 10u);  // frames that follow one another are one line
}

TEST_F(AravisCamera, StopEndsNextAtOnce) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({{"trigger", std::string("software")}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  auto pulled = std::async(std::launch::async, [&] { return (*device)->next(); });
  // Without a trigger there are no frames, and that is not a fault.
  while ((*device)->health().message.empty() &&
         pulled.wait_for(std::chrono::milliseconds(50)) == std::future_status::timeout) {
  }
  EXPECT_THAT((*device)->health().message, HasSubstr("waits for a trigger on software"));
  EXPECT_EQ((*device)->health().state, DeviceState::kRunning);
  (*device)->stop();
  (*device)->stop();
  const auto sample = pulled.get();
  ASSERT_TRUE(sample);
  EXPECT_FALSE(*sample);
  EXPECT_FALSE(*(*device)->next());
  EXPECT_EQ((*device)->health().state, DeviceState::kStopped);
}

TEST_F(AravisCamera, OneCameraIsNotOpenedTwice) {
  FakeGvCamera camera;
  auto device = open_patiently(config_for({}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  const auto second = open_aravis_device(config_for({}), clock_);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().line(),
              HasSubstr("127.0.0.1 is under the control of another program or device"));
  Account account;  // and the first goes on
  ASSERT_TRUE(account.take_until(**device, [&] { return account.frames.size() >= 20; }));
  account.expect_complete();
  DeviceDescription other = (*device)->description();
  other.stream = "camera_1";
  const auto same = same_serial(other, {(*device)->description()});
  ASSERT_TRUE(same);
  EXPECT_THAT(same->line(), HasSubstr("with serial GV01 is already 'camera_0'"));
  other.serial = "GV02";
  EXPECT_FALSE(same_serial(other, {(*device)->description()}));
}

}  // namespace
}  // namespace gnathion
