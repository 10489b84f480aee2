// Corrections by hand over the automatic partition.
#include <gtest/gtest.h>

#include <algorithm>

#include "occlusion/teeth.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

struct Arches {
  testing::SimpleJaws jaws = testing::simple_jaws();
  ArchFrame frame = *find_arch(jaws.maxilla, jaws.mandible);
};
const Arches& arches() {
  static const Arches instance;
  return instance;
}

/// Centroid of a tooth's crown, by the truth.
Vector3 on_tooth(std::uint8_t fdi) {
  Vector3 sum = Vector3::Zero();
  double count = 0.0;
  const auto& truth = arches().jaws.maxilla_fdi;
  for (std::size_t v = 0; v < truth.size(); ++v)
    if (truth[v] == fdi) {
      sum += arches().jaws.maxilla.vertices_mm[v];
      count += 1.0;
    }
  return sum / count;
}

/// The label that most vertices of a (true) tooth were given.
int given_to(std::uint8_t fdi, const ToothCorrections& corrections) {
  const auto found = assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla, corrections);
  std::array<int, 256> votes{};
  for (std::size_t v = 0; v < found.size(); ++v)
    if (arches().jaws.maxilla_fdi[v] == fdi) ++votes[found[v]];
  return static_cast<int>(std::max_element(votes.begin(), votes.end()) - votes.begin());
}

TEST(ToothCorrections, NothingChangesWithoutAny) {
  EXPECT_EQ(assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla),
            assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla, {}));
}

TEST(ToothCorrections, AMissingToothGivesItsNumberToNobodyAndShiftsThoseBehind) {
  // The gap is closed: what looks like 14 is 15, since 14 was taken out.
  const ToothCorrections corrections{{14}, {}};
  EXPECT_EQ(given_to(13, corrections), 13);
  EXPECT_EQ(given_to(14, corrections), 15);
  EXPECT_EQ(given_to(24, corrections), 24);  // the other side stays
  const auto found = assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla, corrections);
  EXPECT_EQ(std::count(found.begin(), found.end(), 14), 0);
}

TEST(ToothCorrections, ALabelHoldsAtItsPlace) {
  // The tooth that the shapes call 15 is told to be 16.
  ToothCorrections corrections;
  corrections.labels.push_back({16, on_tooth(15)});
  corrections.missing.push_back(15);
  EXPECT_EQ(given_to(15, corrections), 16);
  EXPECT_EQ(given_to(21, corrections), 21);
  corrections = {};
  corrections.labels.push_back({25, on_tooth(25)});
  EXPECT_EQ(given_to(25, corrections), 25);
}

TEST(ToothCorrections, OfTheOtherArchAreLeftAlone) {
  ToothCorrections corrections{{36, 46}, {}};
  EXPECT_EQ(assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla, corrections),
            assign_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla));
}

TEST(ToothCorrections, ThatContradictTheArchLeaveNoPartition) {
  ToothCorrections corrections;
  corrections.labels.push_back({14, on_tooth(24)});  // the right one's number on the left ...
  corrections.labels.push_back({24, on_tooth(14)});  // ... and the other way round
  EXPECT_TRUE(
      partition_teeth(arches().jaws.maxilla, arches().frame, Arch::kMaxilla, corrections).fdi.empty());
}

}  // namespace
}  // namespace gnathion
