// The constraints on the virtual patient, truth from the phantom: the short form of `make campaign-check`.
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/realizability_trials.h"

namespace gnathion {
namespace {

TEST(RealizabilityOfThePhantom, EveryConstraintIsJudgedRight) {
  const char* set = std::getenv("GNATHION_SEED");
  const std::uint64_t seed = set ? std::strtoull(set, nullptr, 10) : 4;
  const test::TrialCount count = test::run_trials(seed, 77 + seed, 10);
  for (const std::string& failure : count.failures) ADD_FAILURE() << failure;
  EXPECT_EQ(count.trials, 10);
  EXPECT_EQ(count.violating, 5);
  EXPECT_EQ(count.refused_though_free, 0);
  EXPECT_GE(count.distances, 10);
  EXPECT_LE(count.worst_distance_mm, 0.05);
}

}  // namespace
}  // namespace gnathion
