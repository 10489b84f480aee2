// A bow for real jaws, measured by means that did not make it.
#include "design/bow/bow.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;

std::filesystem::path shared() {
  const char* given = std::getenv("GNATHION_SHARED");
  return given != nullptr ? given : "../shared";
}

TEST(BowPrint, FitsTheCrownsAndIsClearOfTheMaxilla) {
  const auto folder = shared() / "data/jaws/crowns";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "real jaws are not here: " << folder;
  const auto maxilla = read_jaw(folder / "maxilla.stl"), mandible = read_jaw(folder / "mandible_mi.stl");
  ASSERT_TRUE(maxilla && mandible);
  BowParameters p;
  p.fine_mm = 0.3;  // quicker; the gates are the same
  SilentProgress progress;
  const auto design = design_bow({*maxilla, *mandible, {}}, p, progress);
  ASSERT_TRUE(design) << design.error().line();
  for (const Gate& g : design->gates)
    EXPECT_TRUE(g.pass) << g.name << " is " << g.value << ", limit " << g.limit;
  EXPECT_EQ(design->verdict, "pass");

  // Independent of the gates: told in Dental, winding numbers for the side, exact distances the other way.
  const TriangleMesh bow = transformed(design->bow_from_dental.rigid.inverse(), design->bow.surface);
  const MeshTopology t = mesh_topology(bow);
  EXPECT_TRUE(t.watertight());
  EXPECT_TRUE(t.manifold());
  EXPECT_EQ(t.components, 1u);
  EXPECT_GT(signed_volume_mm3(bow), 5000);
  const MeshQuery query(bow);
  double nearest = 100;
  for (const Vector3& v : maxilla->vertices_mm)
    if (const auto hit = query.closest(v, nearest)) nearest = std::min(nearest, hit->distance_mm);
  EXPECT_GE(nearest, 0.5);
  EXPECT_TRUE(intersections(bow, *maxilla, 1).empty());
  EXPECT_TRUE(intersections(bow, *mandible, 1).empty());
  // The clutch lies on the labial side: between the teeth's middle and their tips there is nothing behind it.
  double behind = -1e9;
  for (const Vector3& v : design->clutch.vertices_mm) behind = std::max(behind, v.z());
  EXPECT_LT(behind, 0);  // below the incisal edge
  // Tags: flat squares of the right size with the sticker's thickness over the printed floor.
  const MeshQuery printed(design->bow.surface);
  for (const BodyTag& tag : design->bow.tags.tags) {
    const auto& c = tag.corners_in_body_mm;
    const Vector3 n = (c[1] - c[0]).cross(c[3] - c[0]).normalized();
    EXPECT_LT(n.y(), -0.5);  // away from the patient
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR((c[(k + 1) % 4] - c[k]).norm(), p.tag_side_mm, 1e-9);
      const auto hit = printed.ray(c[k] + 2 * n, -n, 0, 10);
      ASSERT_TRUE(hit);
      EXPECT_NEAR(hit->distance_mm, 2 + p.sticker_thickness_mm, 0.02);
    }
  }
}

TEST(BowParameters, AreReadAndRefusedByName) {
  const auto good = parse_bow_parameters("[bow]\nclutch_thickness_mm = 2.2\nopening_deg = 20\n", "x");
  ASSERT_TRUE(good);
  EXPECT_DOUBLE_EQ(good->clutch_thickness_mm, 2.2);
  EXPECT_DOUBLE_EQ(good->opening_deg, 20);
  EXPECT_THAT(parse_bow_parameters("[bow]\nclutch_thicknes_mm = 2\n", "x").error().line(),
              HasSubstr("clutch_thicknes_mm"));
  EXPECT_THAT(parse_bow_parameters("[bow]\ntag_side_mm = 2\n", "x").error().line(), HasSubstr("tag_side_mm"));
  EXPECT_THAT(parse_bow_parameters("tag_side_mm = 20\n", "x").error().line(), HasSubstr("[bow]"));
}

}  // namespace
}  // namespace gnathion
