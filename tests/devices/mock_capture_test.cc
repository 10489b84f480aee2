// Kind "camera" from a V4L2 camera: the real OpenCV over an emulated driver.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <future>

#include "acquisition/device.h"
#include "tests/support/mock_v4l2.h"

namespace gnathion {
namespace {

using std::chrono::seconds;
using test::MockV4l2;
using test::number_in;
using ::testing::Contains;
using ::testing::HasSubstr;

class MockCapture : public ::testing::Test {
 protected:
  MockCapture() : bed_(umockdev_testbed_new()), camera_(std::make_unique<MockV4l2>(bed_)) {
    camera_->controls = {{V4L2_CID_EXPOSURE_AUTO, {0, 3, 3}},
                         {V4L2_CID_EXPOSURE_ABSOLUTE, {1, 5000, 157}},
                         {V4L2_CID_GAIN, {0, 100, 50}},
                         {V4L2_CID_FOCUS_AUTO, {0, 1, 1}},
                         {V4L2_CID_FOCUS_ABSOLUTE, {0, 250, 0, false, 5}}};
  }
  ~MockCapture() override {
    camera_.reset();
    g_object_unref(bed_);
  }
  DeviceConfig config(std::map<std::string, ConfigValue> settings) const {
    DeviceConfig c;
    c.kind = "camera";
    c.stream = "camera_0";
    c.where = "devices.toml: camera_0";
    settings.emplace("source", std::int64_t{0});
    settings.emplace("queue_frames", 300.0);
    c.settings = std::move(settings);
    return c;
  }
  std::string refusal(std::map<std::string, ConfigValue> settings) {
    const auto device = open_device(config(std::move(settings)), clock_);
    if (device) return "opened";
    std::printf("  %s\n", device.error().line().c_str());
    return device.error().line();
  }
  UMockdevTestbed* bed_;
  std::unique_ptr<MockV4l2> camera_;
  SystemClock clock_;
};

struct Taken {
  std::vector<SampleHeader> frames;
  std::vector<unsigned> numbers;
  std::vector<LedgerSample> lines;
  std::vector<EventSample> events;
  testing::AssertionResult until(Device& device, const std::function<bool()>& enough) {
    const auto end = std::chrono::steady_clock::now() + seconds(60);
    while (!enough()) {
      auto pulled = std::async(std::launch::async, [&] { return device.next(); });
      while (pulled.wait_for(seconds(1)) != std::future_status::ready)
        if (std::chrono::steady_clock::now() > end) device.stop();
      auto sample = pulled.get();
      if (!sample) return testing::AssertionFailure() << sample.error().line();
      if (!*sample) return testing::AssertionFailure() << "ended after " << frames.size() << " frames";
      if (auto* frame = std::get_if<FrameSample>(&**sample)) {
        frames.push_back(frame->header);
        numbers.push_back(number_in(frame->image));
      } else if (auto* line = std::get_if<LedgerSample>(&**sample)) {
        lines.push_back(*line);
      } else if (auto* event = std::get_if<EventSample>(&**sample)) {
        events.push_back(*event);
      }
    }
    return testing::AssertionSuccess();
  }
};

TEST_F(MockCapture, FramesComeWithTheDriversTimesAndGaps) {
  camera_->dropped = [](unsigned n) { return n == 40 || n == 41; };
  camera_->plug();
  auto device = open_device(
      config({{"rate_hz", 60.0}, {"exposure_us", 8000.0}, {"shutter", std::string("global")}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  ASSERT_TRUE(taken.until(**device, [&] { return !taken.numbers.empty() && taken.numbers.back() >= 90; }));
  for (std::size_t i = 0; i < taken.frames.size(); ++i) {
    const SampleHeader &h = taken.frames[i], &first = taken.frames[0];
    EXPECT_EQ(h.sequence - first.sequence, taken.numbers[i] - taken.numbers[0]);
    EXPECT_NEAR(1e-9 * static_cast<double>(h.device.ns - first.device.ns),
                (taken.numbers[i] - taken.numbers[0]) / 60.0, 2e-6);
    EXPECT_LE(h.capture.ns, h.arrival.ns - 4'000'000);
  }
  ASSERT_EQ(taken.lines.size(), 1u);
  EXPECT_EQ(taken.lines[0].fate, LedgerSample::Fate::kMissing);
  EXPECT_EQ(taken.lines[0].count, 2u);
  EXPECT_TRUE((*device)->health().clock.known);
  EXPECT_EQ((*device)->description().model, "Mock Bow Camera");
}

TEST_F(MockCapture, WithAutomaticExposureALongerPeriodIsNoGap) {
  camera_->dropped = [](unsigned n) { return n % 2 == 1; };  // as a camera in the dark: half the rate
  camera_->plug();
  auto device = open_device(config({{"rate_hz", 60.0}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  ASSERT_TRUE(taken.until(**device, [&] { return taken.frames.size() >= 20; }));
  EXPECT_TRUE(taken.lines.empty());
  for (std::size_t i = 1; i < taken.frames.size(); ++i)
    EXPECT_EQ(taken.frames[i].sequence, taken.frames[i - 1].sequence + 1);
  EXPECT_THAT((*device)->description().settings, Contains(HasSubstr("missing frames: not counted")));
}

TEST_F(MockCapture, WhatIsSetIsReadBackAndDifferencesTold) {
  camera_->plug();
  auto device = open_device(config({{"rate_hz", 29.0},
                                    {"exposure_us", 8333.0},
                                    {"gain", 500.0},
                                    {"focus", 123.0},
                                    {"width_px", 1280.0},
                                    {"pixel_format", std::string("MJPG")}}),
                            clock_);
  // 29 Hz becomes 15: not the rate that was asked for.
  ASSERT_FALSE(device);
  EXPECT_THAT(device.error().line(),
              HasSubstr("rate_hz 29 is impossible at 320x240 GREY: the camera gives 15"));
  device = open_device(config({{"rate_hz", 32.0},
                               {"exposure_us", 8333.0},
                               {"gain", 500.0},
                               {"focus", 123.0},
                               {"width_px", 1280.0},
                               {"pixel_format", std::string("MJPG")}}),
                       clock_);
  ASSERT_TRUE(device) << device.error().line();
  const auto d = (*device)->description();
  for (const auto& line : d.settings) std::printf("  %s\n", line.c_str());
  for (const auto& line : d.warnings) std::printf("  warning: %s\n", line.c_str());
  for (const char* line :
       {"exposure_us: 8300 (asked 8333)", "gain: 100 (asked 500)", "focus: 120 (asked 123)",
        "width_px: 320 (asked 1280)", "pixel_format: GREY (asked MJPG)", "rate_hz: 30 (asked 32)"}) {
    EXPECT_THAT(d.settings, Contains(line));
    EXPECT_THAT(d.warnings, Contains(line));
  }
  EXPECT_THAT(d.settings, Contains("autofocus: off"));
  EXPECT_THAT(d.warnings, Contains(HasSubstr("shutter not stated")));
  EXPECT_EQ(camera_->controls[V4L2_CID_EXPOSURE_AUTO].value, 1);
  EXPECT_EQ(camera_->controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 83);
  EXPECT_EQ(camera_->controls[V4L2_CID_FOCUS_AUTO].value, 0);
}

TEST_F(MockCapture, AutofocusThatStaysOnIsRefused) {
  camera_->controls[V4L2_CID_FOCUS_AUTO].stuck = true;
  camera_->plug();
  EXPECT_THAT(refusal({}), HasSubstr("autofocus cannot be turned off"));
}

TEST_F(MockCapture, ACameraWithoutControlsSaysSo) {
  camera_->controls.clear();
  camera_->plug();
  auto device = open_device(config({{"exposure_us", 8000.0}, {"gain", 3.0}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  const auto d = (*device)->description();
  EXPECT_THAT(d.settings, Contains("autofocus: the camera has none"));
  EXPECT_THAT(d.warnings, Contains(HasSubstr("exposure_us: the camera has no such control")));
  EXPECT_THAT(d.warnings, Contains(HasSubstr("gain: the camera has no such control")));
}

TEST_F(MockCapture, AnImpossibleRateIsOneLine) {
  camera_->plug();
  EXPECT_THAT(refusal({{"rate_hz", 500.0}}),
              HasSubstr("rate_hz 500 is impossible at 320x240 GREY: the camera gives 60"));
}

TEST_F(MockCapture, UnpluggedAndPluggedAHundredTimes) {
  camera_->plug();
  auto device = open_device(config({{"rate_hz", 60.0}}), clock_);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  constexpr std::size_t kTimes = 100;
  for (std::size_t i = 1; i <= kTimes; ++i) {
    const std::size_t before = taken.frames.size();
    ASSERT_TRUE(taken.until(**device, [&] { return taken.frames.size() >= before + 2; })) << i;
    camera_->unplug();
    ASSERT_TRUE(taken.until(**device, [&] { return taken.events.size() == 2 * i - 1; })) << i;
    camera_->plug();
    ASSERT_TRUE(taken.until(**device, [&] { return taken.events.size() == 2 * i; })) << i;
  }
  const std::size_t before = taken.frames.size();
  ASSERT_TRUE(taken.until(**device, [&] { return taken.frames.size() >= before + 10; }));
  EXPECT_EQ((*device)->health().reconnects, kTimes);
  std::size_t accounted = taken.frames.size();
  for (const LedgerSample& line : taken.lines) accounted += line.count;
  EXPECT_EQ(taken.frames.back().sequence + 1, accounted);
  for (std::size_t i = 1; i < taken.frames.size(); ++i)
    EXPECT_GT(taken.frames[i].capture.ns, taken.frames[i - 1].capture.ns);
}

TEST_F(MockCapture, WithoutPermissionTheRuleIsNamed) {
  camera_->plug();
  gchar* root = umockdev_testbed_get_root_dir(bed_);
  ASSERT_EQ(::chmod(root, 0755), 0);
  ASSERT_EQ(::chmod((std::string(root) + "/dev/video0").c_str(), 0), 0);
  g_free(root);
  // access() asks for the real user: a child that is nobody.
  const pid_t child = ::fork();
  if (child == 0) {
    if (::getuid() == 0 && (::setgid(65534) != 0 || ::setuid(65534) != 0)) ::_exit(3);
    const auto device = open_device(config({}), clock_);
    const bool named =
        !device && device.error().line().find(
                       "no permission for /dev/video0: install packaging/udev/71-gnathion-cameras.rules") !=
                       std::string::npos;
    if (!named) std::fprintf(stderr, "%s\n", device ? "opened" : device.error().line().c_str());
    ::_exit(named ? 0 : 1);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace gnathion
