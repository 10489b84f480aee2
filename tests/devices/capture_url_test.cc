// Kind "camera" from network cameras, through OpenCV and FFmpeg.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <future>
#include <thread>

#include "acquisition/device.h"
#include "tests/support/video_peer.h"

namespace gnathion {
namespace {

using std::chrono::seconds;
using test::MjpegPeer;
using test::number_in;
using test::RtspPeer;
using ::testing::Contains;
using ::testing::HasSubstr;

DeviceConfig config(std::map<std::string, ConfigValue> settings) {
  DeviceConfig c;
  c.kind = "camera";
  c.stream = "camera_0";
  c.where = "devices.toml: camera_0";
  c.settings = std::move(settings);
  return c;
}

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

/// The camera goes away for a while, twice: lost, back, and numbers go on.
template <class Peer>
void vanish_and_return(Peer& peer, Device& device) {
  Taken taken;
  for (std::size_t round = 0; round < 2; ++round) {
    const std::size_t before = taken.frames.size();
    ASSERT_TRUE(taken.until(device, [&] { return taken.frames.size() >= before + 15; }));
    peer.stop();
    ASSERT_TRUE(taken.until(device, [&] { return taken.events.size() == 2 * round + 1; }));
    EXPECT_EQ(device.health().state, DeviceState::kRecovering);
    peer.start();
    ASSERT_TRUE(taken.until(device, [&] { return taken.events.size() == 2 * round + 2; }));
  }
  const std::size_t before = taken.frames.size();
  ASSERT_TRUE(taken.until(device, [&] { return taken.frames.size() >= before + 15; }));
  EXPECT_EQ(device.health().reconnects, 2u);
  for (std::size_t i = 0; i < taken.events.size(); ++i) {
    EXPECT_EQ(taken.events[i].pressed, i % 2 == 1);
    EXPECT_EQ(taken.events[i].kind, "device");
    EXPECT_THAT(taken.events[i].text, Not(HasSubstr("secret")));
    std::printf("  %s\n", taken.events[i].text.c_str());
  }
  std::uint32_t next = 0;
  for (const LedgerSample& line : taken.lines) next += line.count;
  EXPECT_EQ(taken.frames.back().sequence + 1, taken.frames.size() + next);
  for (std::size_t i = 1; i < taken.frames.size(); ++i)
    EXPECT_GE(taken.frames[i].capture.ns, taken.frames[i - 1].capture.ns);
}

TEST(CaptureUrl, MjpegOverHttp) {
  MjpegPeer peer(30);
  peer.start();
  SystemClock clock;
  auto device = open_device(config({{"source", peer.url()},
                                    {"queue_frames", 300.0},
                                    {"exposure_us", 10000.0},
                                    {"latency_us", 2000.0}}),
                            clock);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  ASSERT_TRUE(taken.until(**device, [&] { return taken.frames.size() >= 40; }));
  for (std::size_t i = 1; i < taken.numbers.size(); ++i)
    EXPECT_EQ(taken.numbers[i], taken.numbers[i - 1] + 1);
  // No clock but arrival: what is known is taken off, exactly.
  for (const SampleHeader& h : taken.frames) {
    EXPECT_EQ(h.arrival.ns - h.capture.ns, 7'000'000);
    EXPECT_EQ(h.device.ns, 0);
  }
  EXPECT_FALSE((*device)->health().clock.known);
  EXPECT_THAT((*device)->description().warnings, Contains(HasSubstr("shutter not stated")));
}

TEST(CaptureUrl, MjpegCameraVanishesAndReturns) {
  MjpegPeer peer(30);
  peer.start();
  SystemClock clock;
  auto device = open_device(config({{"source", peer.url()}, {"queue_frames", 300.0}}), clock);
  ASSERT_TRUE(device) << device.error().line();
  vanish_and_return(peer, **device);
}

TEST(CaptureUrl, RtspTellsTimesAndGaps) {
  RtspPeer peer(30);
  peer.dropped = [](unsigned n) { return n == 60 || n == 61 || n == 75; };
  peer.start();
  SystemClock clock;
  auto device = open_device(config({{"source", peer.url()},
                                    {"queue_frames", 300.0},
                                    {"rate_hz", 30.0},
                                    {"shutter", std::string("rolling")},
                                    {"line_time_us", 20.0}}),
                            clock);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  ASSERT_TRUE(taken.until(**device, [&] { return !taken.numbers.empty() && taken.numbers.back() >= 100; }));
  ASSERT_GT(taken.frames.size(), 50u);
  for (std::size_t i = 0; i < taken.frames.size(); ++i) {
    const SampleHeader& h = taken.frames[i];
    // The stream's number follows the camera's, gaps included.
    EXPECT_EQ(h.sequence - taken.frames[0].sequence, taken.numbers[i] - taken.numbers[0]);
    EXPECT_NEAR(1e-9 * static_cast<double>(h.device.ns - taken.frames[0].device.ns),
                (taken.numbers[i] - taken.numbers[0]) / 30.0, 1e-4);
    // Also for the first, which FFmpeg holds back and gives all at once: evenly spaced, as they were taken.
    EXPECT_NEAR(h.capture.seconds_since(taken.frames[0].capture),
                (taken.numbers[i] - taken.numbers[0]) / 30.0, 0.05);
    // Half a readout of 240 rows before arrival at least.
    EXPECT_LE(h.capture.ns, h.arrival.ns - 2'000'000);
  }
  ASSERT_EQ(taken.lines.size(), 2u);
  EXPECT_EQ(taken.lines[0].count, 2u);
  EXPECT_EQ(taken.lines[1].count, 1u);
  EXPECT_EQ(taken.lines[0].fate, LedgerSample::Fate::kMissing);
  EXPECT_EQ(taken.lines[0].reason, "gap in presentation times");
  const auto health = (*device)->health();
  EXPECT_TRUE(health.clock.known);
  EXPECT_EQ(health.missing, 3u);
  const auto d = (*device)->description();
  EXPECT_THAT(d.warnings, Contains(HasSubstr("rolling shutter")));
  for (const auto& line : d.settings) {
    std::printf("  %s\n", line.c_str());
    EXPECT_THAT(line, Not(HasSubstr("secret")));
  }
  std::printf("  drift %.1f ppm, jitter %.3f ms\n", health.clock.drift_ppm, health.clock.jitter_ms);
}

TEST(CaptureUrl, RtspCameraVanishesAndReturns) {
  RtspPeer peer(30);
  peer.start();
  SystemClock clock;
  auto device =
      open_device(config({{"source", peer.url()}, {"queue_frames", 300.0}, {"rate_hz", 30.0}}), clock);
  ASSERT_TRUE(device) << device.error().line();
  vanish_and_return(peer, **device);
}

TEST(CaptureUrl, ACameraThatHangsIsLostAndNextCanBeStopped) {
  RtspPeer peer(30);
  peer.start();
  SystemClock clock;
  auto device =
      open_device(config({{"source", peer.url()}, {"queue_frames", 300.0}, {"rate_hz", 30.0}}), clock);
  ASSERT_TRUE(device) << device.error().line();
  Taken taken;
  ASSERT_TRUE(taken.until(**device, [&] { return taken.frames.size() >= 10; }));
  peer.hang();
  ASSERT_TRUE(taken.until(**device, [&] { return !taken.events.empty(); }));
  EXPECT_FALSE(taken.events[0].pressed);
  (*device)->stop();
  for (auto sample = (*device)->next(); sample && *sample; sample = (*device)->next()) {
  }
  EXPECT_EQ((*device)->health().state, DeviceState::kStopped);
}

TEST(CaptureUrl, NoOneThereIsOneLine) {
  int port = 0;
  {
    MjpegPeer peer(30);  // a port that was free a moment ago
    peer.start();
    port = peer.port();
  }
  SystemClock clock;
  const auto device =
      open_device(config({{"source", "http://user:secret@127.0.0.1:" + std::to_string(port) + "/x"}}), clock);
  ASSERT_FALSE(device);
  std::printf("  %s\n", device.error().line().c_str());
  EXPECT_THAT(device.error().line(), HasSubstr("no video from http://user:***@127.0.0.1"));
}

}  // namespace
}  // namespace gnathion
