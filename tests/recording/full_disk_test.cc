// A disk that is full stops the recording with an error; the file is valid, and each sample is in it or has
// its line.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "acquisition/session.h"
#include "core/file.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// Frames that do not compress, as fast as they are taken, until the disk is full.
struct Outcome {
  Status status;
  std::map<std::string, std::uint32_t> delivered;
  SessionStatus last;
};

Outcome record_until_full(const fs::path& path) {
  SystemClock clock;
  Image8 noise(512, 512);
  Random random(8);
  for (auto& p : noise.pixels) p = static_cast<std::uint8_t>(random.next_u32());
  std::vector<std::unique_ptr<Device>> devices;
  std::vector<const SyntheticDevice*> synthetic;
  const auto add = [&](const char* stream, double rate_hz, SyntheticDevice::Maker maker) {
    auto device = std::make_unique<SyntheticDevice>(SyntheticDevice::Options{stream, rate_hz, 0, -1},
                                                    std::move(maker), clock);
    synthetic.push_back(device.get());
    devices.push_back(std::move(device));
  };
  add("camera_0", 100, camera_maker({noise}));
  add("camera_1", 60, camera_maker({noise}));
  add("tracker", 240, tracker_maker());
  auto session = Session::start(path, std::move(devices), {}, clock);
  EXPECT_TRUE(session) << session.error().line();
  EXPECT_TRUE((*session)->wait_for(100)) << "the disk did not fill";
  Outcome outcome;
  outcome.status = (*session)->finish();
  outcome.last = (*session)->status();
  for (const SyntheticDevice* device : synthetic)
    outcome.delivered[device->description().stream] = device->delivered();
  return outcome;
}

void expect_valid_and_accounted(const fs::path& path, const Outcome& outcome) {
  ASSERT_FALSE(outcome.status);
  const auto summary = summarise_recording(path);
  ASSERT_TRUE(summary) << summary.error().line();
  EXPECT_TRUE(summary->whole) << summary->damage;
  std::map<std::string, std::vector<int>> seen;
  for (const auto& [stream, n] : outcome.delivered) seen[stream].assign(n, 0);
  auto source = RecordingSource::open(path);
  ASSERT_TRUE(source) << source.error().line();
  while (true) {
    const auto next = (*source)->next();
    ASSERT_TRUE(next) << next.error().line();
    if (!*next) break;
    const SampleHeader& h = header_of(**next);
    const auto* line = std::get_if<LedgerSample>(&**next);
    for (std::uint32_t i = 0; i < (line ? line->count : 1); ++i) ++seen.at(h.stream).at(h.sequence + i);
  }
  for (const auto& [stream, counts] : seen) {
    EXPECT_EQ(static_cast<std::size_t>(std::count(counts.begin(), counts.end(), 1)), counts.size()) << stream;
    const LedgerCounts& live = outcome.last.ledger.at(stream);
    std::uint64_t rejected = 0;
    for (const auto& [reason, n] : live.rejected) rejected += n;
    EXPECT_EQ(live.received + rejected, counts.size()) << stream;
    EXPECT_EQ(live.received, summary->streams.at(stream).received) << stream;
  }
}

class FullDiskTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_full_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

TEST_F(FullDiskTest, ASmallDiskThatFillsUp) {
  const bool may_mount =
      ::unshare(CLONE_NEWNS) == 0 && ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;
  if (!may_mount || ::mount("tmpfs", folder_.c_str(), "tmpfs", 0, "size=24m") != 0)
    GTEST_SKIP() << "no permission to mount a small file system";
  const Outcome outcome = record_until_full(folder_ / "r.mcap");
  EXPECT_THAT(outcome.status.error().line(), HasSubstr("No space left on device"));
  EXPECT_GT(fs::file_size(folder_ / "r.mcap"), 20u << 20);  // not much was kept back
  expect_valid_and_accounted(folder_ / "r.mcap", outcome);
  if (std::getenv("GNATHION_KEEP_RECORDINGS"))
    fs::copy_file(folder_ / "r.mcap", fs::path(std::getenv("GNATHION_KEEP_RECORDINGS")) / "full_disk.mcap",
                  fs::copy_options::overwrite_existing);
  ::umount(folder_.c_str());
}

/// A file that may not grow further (FAT32's 4 GiB, a quota): the reserve does not help, the last chunks give
/// way.
TEST_F(FullDiskTest, AFileThatMayNotGrow) {
  ::signal(SIGXFSZ, SIG_IGN);
  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const rlimit small{7u << 20, old.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const Outcome outcome = record_until_full(folder_ / "r.mcap");
  ::setrlimit(RLIMIT_FSIZE, &old);
  EXPECT_THAT(outcome.status.error().line(), HasSubstr("File too large"));
  expect_valid_and_accounted(folder_ / "r.mcap", outcome);
}

TEST_F(FullDiskTest, NoRoomFromTheStart) {
  ::signal(SIGXFSZ, SIG_IGN);
  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const rlimit tiny{100, old.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &tiny), 0);
  SystemClock clock;
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(
      std::make_unique<SyntheticDevice>(SyntheticDevice::Options{"pedal", 10, 0, -1}, pedal_maker(), clock));
  const auto session = Session::start(folder_ / "r.mcap", std::move(devices), {}, clock);
  ::setrlimit(RLIMIT_FSIZE, &old);
  ASSERT_FALSE(session);
  EXPECT_THAT(session.error().line(), HasSubstr("cannot write recording"));
  EXPECT_FALSE(fs::exists(folder_ / "r.mcap"));
}

}  // namespace
}  // namespace gnathion
