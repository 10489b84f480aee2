#include "acquisition/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <set>
#include <thread>

#include "acquisition/replay_device.h"
#include "acquisition/session_queue.h"
#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// A device that plays what a test wrote: each call gives a sample, an error, or waits for stop().
class ScriptedDevice : public Device {
 public:
  using Script = std::function<Result<std::optional<Sample>>(int call, ScriptedDevice& device)>;
  ScriptedDevice(std::string stream, Script script)
      : stream_(std::move(stream)), script_(std::move(script)) {}
  Result<std::optional<Sample>> next() override { return script_(call_++, *this); }
  DeviceDescription description() const override {
    DeviceDescription d;
    d.kind = "scripted";
    d.stream = stream_;
    d.settings = {"exposure_us: 8000 (asked 8333)"};
    return d;
  }
  DeviceHealth health() const override { return {}; }
  void stop() override {
    std::lock_guard lock(mutex_);
    stopped_ = true;
    changed_.notify_all();
  }
  /// True when stopped, false after `ms`.
  bool wait_ms(int ms) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::milliseconds(ms), [&] { return stopped_; });
  }
  std::optional<Sample> wait_for_stop() {
    while (!wait_ms(1000)) {
    }
    return std::nullopt;
  }

 private:
  std::string stream_;
  Script script_;
  int call_ = 0;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopped_ = false;
};

class SessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_session_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path file() const { return folder_ / "session.mcap"; }

  SampleHeader header(const std::string& stream, int sequence) {
    const HostTime now = clock_.now();
    return {stream, static_cast<std::uint32_t>(sequence), {now.ns - 5'000'000}, now, {sequence * 1000}};
  }
  std::unique_ptr<Device> camera(const std::string& stream, int frames, int side_px) {
    return std::make_unique<ScriptedDevice>(
        stream, [=, this](int call, ScriptedDevice&) -> Result<std::optional<Sample>> {
          if (call == frames) return std::optional<Sample>();
          FrameSample f{header(stream, call), Image8(side_px, side_px)};
          Random random(static_cast<std::uint64_t>(call));
          for (auto& p : f.image.pixels) p = static_cast<std::uint8_t>(random.next_u32());
          return std::optional<Sample>(std::move(f));
        });
  }
  std::map<std::string, std::vector<Sample>> replay() {
    std::map<std::string, std::vector<Sample>> streams;
    auto source = RecordingSource::open(file());
    EXPECT_TRUE(source) << source.error().line();
    while (source) {
      auto next = (*source)->next();
      EXPECT_TRUE(next) << next.error().line();
      if (!next || !*next) break;
      streams[header_of(**next).stream].push_back(std::move(**next));
    }
    return streams;
  }

  fs::path folder_;
  SystemClock clock_;
};

TEST_F(SessionTest, RecordsSeveralDevicesAndTellsHowTheyWereSet) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(camera("camera_0", 50, 64));
  devices.push_back(camera("camera_1", 70, 32));
  SessionOptions options;
  options.software_version = "1.2.3";
  options.attachments = {{"devices.toml", "[[device]]\n"}};
  auto session = Session::start(file(), std::move(devices), options, clock_);
  ASSERT_TRUE(session) << session.error().line();
  EXPECT_TRUE((*session)->wait_for(60));
  ASSERT_TRUE((*session)->finish());
  const SessionStatus status = (*session)->status();
  EXPECT_FALSE(status.running);
  EXPECT_EQ(status.ledger.at("camera_0").received, 50u);
  EXPECT_EQ(status.ledger.at("camera_1").received, 70u);
  EXPECT_EQ(status.synced_bytes, status.file_bytes);
  EXPECT_EQ(status.file_bytes, fs::file_size(file()));
  auto streams = replay();
  ASSERT_EQ(streams.at("camera_1").size(), 70u);
  for (std::uint32_t i = 0; i < 70; ++i) EXPECT_EQ(header_of(streams.at("camera_1")[i]).sequence, i);
  auto source = RecordingSource::open(file());
  EXPECT_EQ(*(*source)->attachment("devices.toml"), "[[device]]\n");
  EXPECT_THAT(*(*source)->attachment("session.json"), HasSubstr("1.2.3"));
  EXPECT_THAT(*(*source)->attachment("session.json"), HasSubstr("exposure_us: 8000 (asked 8333)"));
  EXPECT_THAT(*(*source)->attachment("session_end.json"), HasSubstr("camera_1"));
}

TEST_F(SessionTest, TellsEveryLoneFrameOfARigAndKeepsIt) {
  // Two cameras of one trigger, 60 Hz; the second one misses frames 7 and 30, its last frame comes 6 ms late.
  const auto triggered = [this](const std::string& stream, bool second) {
    return std::make_unique<ScriptedDevice>(
        stream, [=, this, n = 0](int, ScriptedDevice&) mutable -> Result<std::optional<Sample>> {
          while (second && (n == 7 || n == 30)) ++n;
          if (n == 50) return std::optional<Sample>();
          const std::int64_t late_ns = second ? (n == 49 ? 6'000'000 : 300'000) : 0;
          const SampleHeader h{stream,
                               static_cast<std::uint32_t>(n),
                               {1'000'000'000 + n * 16'666'667 + late_ns},
                               clock_.now(),
                               {n * 1000}};
          ++n;
          return std::optional<Sample>(FrameSample{h, Image8(8, 8)});
        });
  };
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(triggered("camera_0", false));
  devices.push_back(triggered("camera_1", true));
  SessionOptions options;
  options.rigs = {{"chair", {}}};
  options.rigs.front().sync.streams = {"camera_0", "camera_1"};
  options.rigs.front().sync.max_lag_ns = 10'000'000'000;  // nothing here waits for its time
  auto session = Session::start(file(), std::move(devices), options, clock_);
  ASSERT_TRUE(session) << session.error().line();
  EXPECT_TRUE((*session)->wait_for(60));
  ASSERT_TRUE((*session)->finish());
  const SessionStatus status = (*session)->status();
  ASSERT_EQ(status.rigs.size(), 1u);
  EXPECT_EQ(status.rigs[0].sets, 47u);
  EXPECT_EQ(status.rigs[0].lone, 4u);
  auto streams = replay();
  std::set<std::string> told;
  for (const Sample& sample : streams.at("chair/sync")) told.insert(std::get<EventSample>(sample).text);
  EXPECT_EQ(told, (std::set<std::string>{
                      "camera_0 7: no partner within 4.0 ms", "camera_0 30: no partner within 4.0 ms",
                      "camera_0 49: no partner within 4.0 ms", "camera_1 49: no partner within 4.0 ms"}));
  EXPECT_EQ(status.ledger.at("camera_0").received, 50u);
  EXPECT_EQ(status.ledger.at("camera_1").received, 48u);
}

TEST_F(SessionTest, DevicesThatFailOrThrowDoNotStopTheOthers) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(
      std::make_unique<ScriptedDevice>("pedal", [](int, ScriptedDevice&) -> Result<std::optional<Sample>> {
        return fail(ErrorCode::kInternal, "cannot read pedal", "pedal", "unplugged for good");
      }));
  devices.push_back(std::make_unique<ScriptedDevice>(
      "tracker",
      [](int, ScriptedDevice&) -> Result<std::optional<Sample>> { throw std::runtime_error("a bug"); }));
  devices.push_back(camera("camera_0", 200, 16));
  auto session = Session::start(file(), std::move(devices), {}, clock_);
  ASSERT_TRUE(session);
  EXPECT_TRUE((*session)->wait_for(60));
  ASSERT_TRUE((*session)->finish());
  const SessionStatus status = (*session)->status();
  EXPECT_EQ(status.devices[0].health.state, DeviceState::kFailed);
  EXPECT_THAT(status.devices[0].health.message, HasSubstr("unplugged for good"));
  auto streams = replay();
  EXPECT_EQ(streams.at("camera_0").size(), 200u);
  EXPECT_THAT(std::get<EventSample>(streams.at("pedal/state").at(0)).text, HasSubstr("unplugged for good"));
  EXPECT_FALSE(std::get<EventSample>(streams.at("pedal/state").at(0)).pressed);
  EXPECT_THAT(std::get<EventSample>(streams.at("tracker/state").at(0)).text, HasSubstr("a bug"));
}

/// The disk cannot keep up with a device that delivers without pause: every frame is in the file or has its
/// line.
TEST_F(SessionTest, AFullQueueLeavesALineForEachFrame) {
  constexpr int kFrames = 3000;
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(camera("camera_0", kFrames, 128));
  devices.push_back(camera("camera_1", kFrames, 128));
  SessionOptions options;
  options.queue_bytes = 100'000;
  options.reserve_bytes = 2'000;  // lines run out of room too
  auto session = Session::start(file(), std::move(devices), options, clock_);
  ASSERT_TRUE(session);
  EXPECT_TRUE((*session)->wait_for(100));
  ASSERT_TRUE((*session)->finish());
  EXPECT_LE((*session)->status().queue_peak_bytes, 102'000u);
  for (const auto& [stream, samples] : replay()) {
    std::vector<int> seen(kFrames, 0);
    std::uint32_t rejected = 0;
    for (const Sample& s : samples) {
      if (const auto* line = std::get_if<LedgerSample>(&s)) {
        EXPECT_EQ(line->fate, LedgerSample::Fate::kRejected);
        EXPECT_EQ(line->reason, "queue full");
        for (std::uint32_t i = 0; i < line->count; ++i) ++seen.at(line->header.sequence + i);
        rejected += line->count;
      } else {
        ++seen.at(header_of(s).sequence);
      }
    }
    EXPECT_GT(rejected, 0u) << stream;
    EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), kFrames) << stream;
  }
}

TEST_F(SessionTest, ALoneSampleComesToTheDiskThoughNothingFollows) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::make_unique<ScriptedDevice>(
      "pedal", [this](int call, ScriptedDevice& device) -> Result<std::optional<Sample>> {
        if (call > 0) return device.wait_for_stop();
        return std::optional<Sample>(EventSample{header("pedal", 0), "MI", true, ""});
      }));
  auto session = Session::start(file(), std::move(devices), {}, clock_);
  ASSERT_TRUE(session);
  bool there = false;
  for (int tries = 0; tries < 600 && !there; ++tries) {
    EXPECT_FALSE((*session)->wait_for(0.05));
    ASSERT_TRUE(recover_recording(file(), folder_ / "saved.mcap"));
    there = summarise_recording(folder_ / "saved.mcap")->streams.count("pedal") > 0;
  }
  EXPECT_TRUE(there);
  const auto synced = [&] {
    const SessionStatus s = (*session)->status();
    return s.synced_bytes == s.file_bytes;
  };
  for (int tries = 0; tries < 600 && !synced(); ++tries) (*session)->wait_for(0.05);
  EXPECT_TRUE(synced());
  EXPECT_TRUE((*session)->finish());
  EXPECT_TRUE((*session)->finish());  // idempotent
}

TEST_F(SessionTest, ADriverThatHangsIsLeftBehind) {
  auto release = std::make_shared<std::atomic<bool>>(false);
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::make_unique<ScriptedDevice>(
      "stuck", [release](int, ScriptedDevice& device) -> Result<std::optional<Sample>> {
        device.wait_for_stop();
        while (!*release) std::this_thread::yield();
        return std::optional<Sample>();
      }));
  devices.push_back(camera("camera_0", 20, 16));
  auto session = Session::start(file(), std::move(devices), {}, clock_);
  ASSERT_TRUE(session);
  ASSERT_TRUE((*session)->finish());
  EXPECT_THAT((*session)->status().devices[0].health.message, HasSubstr("did not stop"));
  session->reset();
  EXPECT_TRUE(summarise_recording(file())->whole);
  *release = true;
}

TEST_F(SessionTest, StatusMayBeAskedWhileItRuns) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(camera("camera_0", 2000, 64));
  auto session = Session::start(file(), std::move(devices), {}, clock_);
  ASSERT_TRUE(session);
  std::uint64_t last = 0;
  while (!(*session)->wait_for(0.001)) {
    const SessionStatus status = (*session)->status();
    const auto counts = status.ledger.find("camera_0");
    const std::uint64_t now = counts == status.ledger.end() ? 0 : counts->second.received;
    EXPECT_GE(now, last);
    EXPECT_LE(status.synced_bytes, status.file_bytes);
    last = now;
  }
  ASSERT_TRUE((*session)->finish());
  EXPECT_EQ((*session)->status().ledger.at("camera_0").received, 2000u);
}

TEST_F(SessionTest, ARecordingIsADeviceLikeAnyOther) {
  {
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(camera("camera_0", 100, 16));
    ASSERT_TRUE((*Session::start(file(), std::move(devices), {}, clock_))->finish());
  }
  const auto first = replay();
  const fs::path copy = folder_ / "copy.mcap";
  fs::rename(file(), copy);
  DeviceConfig config;
  config.kind = "replay";
  config.stream = "replayed";
  config.settings = {{"path", copy.string()}, {"speed", 0.0}};
  auto device = open_replay_device(config, clock_);
  ASSERT_TRUE(device) << device.error().line();
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(*device));
  auto session = Session::start(file(), std::move(devices), {}, clock_);
  (*session)->wait_for(60);
  ASSERT_TRUE((*session)->finish());
  const auto second = replay();
  ASSERT_EQ(first.at("camera_0").size(), second.at("camera_0").size());
  for (std::size_t i = 0; i < first.at("camera_0").size(); ++i) {
    const auto& a = std::get<FrameSample>(first.at("camera_0")[i]);
    const auto& b = std::get<FrameSample>(second.at("camera_0")[i]);
    EXPECT_EQ(a.header.arrival, b.header.arrival);
    EXPECT_EQ(a.header.device, b.header.device);
    EXPECT_EQ(a.image.pixels, b.image.pixels);
  }
  config.settings["sped"] = 1.0;
  EXPECT_THAT(open_replay_device(config, clock_).error().line(), HasSubstr("'speed' is meant?"));
}

TEST_F(SessionTest, NoDeviceIsRefused) {
  const auto session = Session::start(file(), {}, {}, clock_);
  ASSERT_FALSE(session);
  EXPECT_EQ(exit_code(session.error().code), 4);
  EXPECT_FALSE(fs::exists(file()));
}

}  // namespace
}  // namespace gnathion
