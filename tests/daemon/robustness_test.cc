// Short forms of the campaign: what must hold on any machine, however busy; times are not asserted.
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/daemon/campaign_parts.h"

namespace gnathion::testing {
namespace {

std::uint64_t seed() {
  const char* given = std::getenv("GNATHION_SEED");
  return given ? std::strtoull(given, nullptr, 10) : 5;
}

TEST(DaemonRobustness, AStalledSubscriberCostsNobodyAFrame) {
  const LatencyResult r = measure_latency(2, 320, 240);
  EXPECT_EQ(r.fault, "");
  EXPECT_GT(r.updates, 200u);
  EXPECT_GT(r.recorded_frames, 120u);
  EXPECT_EQ(r.lost_frames, 0u);
  EXPECT_GE(r.stalled_seen, 1u);
}

TEST(DaemonRobustness, CallsWithConnectionsCut) {
  const CallsResult r = make_calls(480, 16, 0.05, seed());
  EXPECT_EQ(r.fault, "");
  EXPECT_EQ(r.wrong, 0);
  EXPECT_GT(r.cuts, 5);
  EXPECT_EQ(r.calls, 480);
  EXPECT_LE(r.connections_after, 1u);
  EXPECT_EQ(r.streams_after, 0u);
}

TEST(DaemonRobustness, KilledAtRandomPoints) {
  const KillsResult r = kill_at_random(8, seed());
  EXPECT_EQ(r.fault, "");
  EXPECT_EQ(r.failed_restarts + r.unopened + r.half_written, 0);
}

TEST(DaemonRobustness, MemoryStaysFlat) {
  const MemoryResult r = replay_poses(2);
  EXPECT_EQ(r.fault, "");
  ASSERT_GE(r.rows.size(), 6u);
  // After the first sessions have filled what is reused.
  EXPECT_LT(r.rows.back().memory_mib - r.rows[r.rows.size() / 2].memory_mib, 16);
  EXPECT_GT(r.rows.back().received, 1000u);
}

}  // namespace
}  // namespace gnathion::testing
