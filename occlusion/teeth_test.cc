#include "occlusion/teeth.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>

#include "core/mesh_io.h"
#include "core/random.h"
#include "occlusion/crowns.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

std::filesystem::path shared() {
  const char* set = std::getenv("GNATHION_SHARED");
  return set ? std::filesystem::path(set) : std::filesystem::path("../shared");
}

TEST(Fdi, OrderSidesAndPositions) {
  const auto upper = fdi_order(Arch::kMaxilla), lower = fdi_order(Arch::kMandible);
  ASSERT_EQ(upper.size(), 16u);
  EXPECT_EQ(upper.front(), 18);
  EXPECT_EQ(upper[7], 11);
  EXPECT_EQ(upper[8], 21);
  EXPECT_EQ(lower.front(), 48);
  EXPECT_EQ(lower.back(), 38);
  EXPECT_EQ(fdi_side(36), 1);
  EXPECT_EQ(fdi_side(16), -1);
  EXPECT_EQ(fdi_side(0), 0);
  EXPECT_TRUE(fdi_is_front(43));
  EXPECT_FALSE(fdi_is_front(44));
  EXPECT_FALSE(fdi_is_front(0));
}

TEST(AssignTeeth, NumbersTheCrownsOfKnownArchesInAnyPose) {
  const auto jaws = testing::simple_jaws();
  for (std::uint64_t seed = 30; seed < 33; ++seed) {
    Random random(seed);
    const Rigid3 x{random.rotation(), 100.0 * random.normal3()};
    const auto maxilla = transformed(x, jaws.maxilla), mandible = transformed(x, jaws.mandible);
    const auto frame = find_arch(maxilla, mandible);
    ASSERT_TRUE(frame) << frame.error().line();
    auto right_share = [&](const TriangleMesh& mesh, Arch which, const std::vector<std::uint8_t>& truth) {
      const auto found = assign_teeth(mesh, *frame, which);
      std::size_t crown = 0, right = 0;
      for (std::size_t i = 0; i < truth.size(); ++i) {
        if (truth[i] == 0) continue;
        ++crown;
        right += found[i] == truth[i];
      }
      return static_cast<double>(right) / static_cast<double>(crown);
    };
    EXPECT_GT(right_share(maxilla, Arch::kMaxilla, jaws.maxilla_fdi), 0.95);
    EXPECT_GT(right_share(mandible, Arch::kMandible, jaws.mandible_fdi), 0.95);
  }
}

// The "crowns" pair consists of separate crowns: its components are the truth.
TEST(AssignTeeth, AgreesWithTheSeparateCrownsOfARealPair) {
  const auto folder = shared() / "data/jaws/crowns";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real jaws at " << folder;
  const auto maxilla = read_jaw(folder / "maxilla.stl"), mandible = read_jaw(folder / "mandible_mi.stl");
  ASSERT_TRUE(maxilla && mandible);
  const auto frame = find_arch(*maxilla, *mandible);
  ASSERT_TRUE(frame);
  for (const Arch which : {Arch::kMaxilla, Arch::kMandible}) {
    const TriangleMesh& mesh = which == Arch::kMaxilla ? *maxilla : *mandible;
    const auto fdi = assign_teeth(mesh, *frame, which);
    std::size_t count = 0;
    const auto component = triangle_components(mesh, &count);
    ASSERT_EQ(count, 14u);
    std::vector<std::map<std::uint8_t, std::size_t>> votes(count);
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) ++votes[component[t]][fdi[mesh.triangles[t][0]]];
    std::set<std::uint8_t> seen;
    std::size_t pure = 0;
    for (const auto& vote : votes) {
      const auto best = std::max_element(vote.begin(), vote.end(),
                                         [](const auto& a, const auto& b) { return a.second < b.second; });
      pure += best->second;
      seen.insert(best->first);
    }
    EXPECT_GT(static_cast<double>(pure) / static_cast<double>(mesh.triangles.size()), 0.97);
    std::set<std::uint8_t> expected;  // central incisors to second molars
    for (const auto f : fdi_order(which))
      if (fdi_position(f) <= 7) expected.insert(f);
    EXPECT_EQ(seen, expected);
  }
}

TEST(CrownRegion, KeepsCrownsToTheGivenDepth) {
  const auto jaws = testing::simple_jaws();
  const auto frame = find_arch(jaws.maxilla, jaws.mandible);
  ASSERT_TRUE(frame);
  const auto region = crown_region(jaws.maxilla, *frame, Arch::kMaxilla, 3.0);
  const auto depth = crown_depths_mm(jaws.maxilla, *frame, Arch::kMaxilla);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < region.size(); ++i) {
    kept += region[i];
    if (region[i]) {
      EXPECT_LT(depth[i], 3.5);
    } else if (jaws.maxilla_fdi[i] != 0) {
      EXPECT_GT(depth[i], 2.5) << jaws.maxilla.vertices_mm[i].transpose();
    }
  }
  EXPECT_GT(kept, region.size() / 4);
  const auto cut = region_mesh(jaws.maxilla, region);
  EXPECT_LT(bounding_box(cut).max_mm.z(), 3.7);
  const auto facing = occlusal_facing(jaws.maxilla, *frame, Arch::kMaxilla, 40.0);
  const auto normals = vertex_normals(jaws.maxilla);
  for (std::size_t i = 0; i < facing.size(); i += 7)
    EXPECT_EQ(facing[i], normals[i].dot(-frame->up) >= std::cos(0.6981317));
}

}  // namespace
}  // namespace gnathion
