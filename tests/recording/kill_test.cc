// kill -9 at random instants: what is older than 200 ms is readable after recovery; after a power loss, where
// only what was synced survives, what is older than 1 s. `kill_test N` runs N kills and prints a table.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <set>
#include <thread>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/random.h"
#include "tests/support/synthetic_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
int kills = 5;
int width_px = 320, height_px = 240;

using SampleId = std::pair<std::string, std::uint32_t>;

/// What the killed process left in its log.
struct Truth {
  std::map<SampleId, std::int64_t> arrival_ns;
  std::int64_t synced_bytes = 0, longest_sync_ns = 0;
  std::vector<std::pair<std::int64_t, std::int64_t>>
      waits_ns;  ///< time; how long threads got no core, no disk
};

/// For how long the machine, not the recorder, held samples up before the kill. On a machine with a core to
/// spare this is some milliseconds.
std::int64_t held_up_ns(const Truth& truth, std::int64_t killed_ns) {
  constexpr std::int64_t kWindow_ns = 1'500'000'000;
  std::int64_t sum = 0, last = truth.waits_ns.empty() ? killed_ns : truth.waits_ns.back().first;
  for (const auto& [time_ns, waited_ns] : truth.waits_ns)
    if (time_ns > killed_ns - kWindow_ns) sum += waited_ns;
  return sum + std::max<std::int64_t>(0, killed_ns - last);
}

Truth read_truth(const fs::path& log) {
  Truth truth;
  const std::string bytes = *read_file(log);
  for (std::size_t at = 0; at + sizeof(DeliveredSample) <= bytes.size(); at += sizeof(DeliveredSample)) {
    DeliveredSample entry;
    std::memcpy(&entry, bytes.data() + at, sizeof entry);
    const std::string stream = entry.stream;
    if (stream == "synced")
      truth.synced_bytes = entry.arrival_ns;
    else if (stream == "longest sync")
      truth.longest_sync_ns = entry.arrival_ns;
    else if (stream == "waited")
      truth.waits_ns.emplace_back(entry.arrival_ns, 1000LL * entry.sequence);
    else
      truth.arrival_ns[{stream, entry.sequence}] = entry.arrival_ns;
  }
  return truth;
}

std::set<SampleId> samples_in(const fs::path& recording) {
  std::set<SampleId> ids;
  auto source = RecordingSource::open(recording);
  EXPECT_TRUE(source) << source.error().line();
  while (source) {
    const auto next = (*source)->next();
    EXPECT_TRUE(next) << next.error().line();
    if (!next || !*next) break;
    // A frame that the queue had no room for is accounted for by its line.
    if (const auto* line = std::get_if<LedgerSample>(&**next)) {
      for (std::uint32_t i = 0; i < line->count; ++i)
        ids.insert({line->header.stream, line->header.sequence + i});
    } else {
      ids.insert({header_of(**next).stream, header_of(**next).sequence});
    }
  }
  return ids;
}

/// Age, at the kill, of the oldest sample that is not in the recording; 0 when all are.
std::int64_t oldest_lost_ns(const Truth& truth, const fs::path& recording, std::int64_t killed_ns) {
  const std::set<SampleId> saved = samples_in(recording);
  std::int64_t oldest = 0;
  for (const auto& [id, arrival_ns] : truth.arrival_ns)
    if (!saved.count(id)) oldest = std::max(oldest, killed_ns - arrival_ns);
  return oldest;
}

pid_t start_recorder(const fs::path& out, const fs::path& log) {
  const std::string width = std::to_string(width_px), height = std::to_string(height_px);
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl(GNATHION_RECORDER, GNATHION_RECORDER, out.c_str(), log.c_str(), width.c_str(), height.c_str(),
            nullptr);
    ::_exit(127);
  }
  return child;
}

/// Until the recorder has made samples for `seconds`, counted from its first.
void wait_for_samples(const fs::path& log, double seconds, Clock& clock) {
  std::error_code ec;
  for (int i = 0; i < 12000 && (!fs::exists(log, ec) || fs::file_size(log, ec) == 0); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  ClockWaiter(clock).wait_until({clock.now().ns + static_cast<std::int64_t>(1e9 * seconds)});
}

TEST(Kill, WhatIsOlderThan200msSurvivesAndAfterAPowerLossWhatIsOlderThan1s) {
  const fs::path folder = fs::temp_directory_path() / ("gnathion_kill_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const fs::path out = folder / "r.mcap", log = folder / "log", saved = folder / "saved.mcap",
                 cut = folder / "cut.mcap";
  std::random_device entropy;
  SystemClock clock;
  std::int64_t worst_kill_ns = 0, worst_power_ns = 0;
  int over_200ms = 0, over_1s = 0;  // by the clock alone
  std::size_t samples = 0;
  for (int k = 0; k < kills; ++k) {
    const std::uint64_t seed = entropy();
    Random random(seed);
    fs::remove(log);
    const pid_t child = start_recorder(out, log);
    ASSERT_GT(child, 0);
    wait_for_samples(log, random.uniform(0.05, 3.0), clock);
    const std::int64_t killed_ns = clock.now().ns;
    ASSERT_EQ(::kill(child, SIGKILL), 0);
    int how = 0;
    ASSERT_EQ(::waitpid(child, &how, 0), child);
    ASSERT_TRUE(WIFSIGNALED(how)) << "the recorder ended by itself";

    const Truth truth = read_truth(log);
    ASSERT_FALSE(truth.arrival_ns.empty());
    ASSERT_TRUE(recover_recording(out, saved));
    const std::int64_t kill_ns = oldest_lost_ns(truth, saved, killed_ns);
    const std::int64_t held_ns = held_up_ns(truth, killed_ns);
    EXPECT_LE(kill_ns, 200'000'000 + held_ns) << "seed " << seed << ", held up for " << held_ns << " ns";

    fs::copy_file(out, cut, fs::copy_options::overwrite_existing);
    ASSERT_LE(static_cast<std::uint64_t>(truth.synced_bytes), fs::file_size(out));
    fs::resize_file(cut, static_cast<std::uint64_t>(std::max<std::int64_t>(truth.synced_bytes, 1)));
    std::int64_t power_ns = 0;
    for (const auto& [id, arrival_ns] : truth.arrival_ns)
      power_ns = std::max(power_ns, killed_ns - arrival_ns);
    if (recover_recording(cut, saved)) power_ns = oldest_lost_ns(truth, saved, killed_ns);
    const std::int64_t slow_disk_ns = std::max<std::int64_t>(0, truth.longest_sync_ns - 400'000'000);
    EXPECT_LE(power_ns, 1'000'000'000 + held_ns + 2 * slow_disk_ns) << "seed " << seed;
    if (kills > 20)
      std::printf("%4d: lost %4.0f ms, power loss %4.0f ms, held up %4.0f ms\n", k,
                  1e-6 * static_cast<double>(kill_ns), 1e-6 * static_cast<double>(power_ns),
                  1e-6 * static_cast<double>(held_ns));
    std::fflush(stdout);
    over_200ms += kill_ns > 200'000'000;
    over_1s += power_ns > 1'000'000'000;
    worst_kill_ns = std::max(worst_kill_ns, kill_ns);
    worst_power_ns = std::max(worst_power_ns, power_ns);
    samples += truth.arrival_ns.size();
  }
  std::printf(
      "%d kills, %zu samples, %dx%d px: oldest lost sample %.0f ms old (%d times above 200 ms); after a "
      "power "
      "loss %.0f ms old (%d times above 1 s)\n",
      kills, samples, width_px, height_px, 1e-6 * static_cast<double>(worst_kill_ns), over_200ms,
      1e-6 * static_cast<double>(worst_power_ns), over_1s);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (argc > 1) gnathion::kills = std::atoi(argv[1]);
  if (argc > 3) {
    gnathion::width_px = std::atoi(argv[2]);
    gnathion::height_px = std::atoi(argv[3]);
  }
  return RUN_ALL_TESTS();
}
