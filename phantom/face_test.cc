#include "phantom/face.h"

#include <gtest/gtest.h>

#include "core/mesh_query.h"

namespace gnathion {
namespace {

/// Where the skin is met coming from the front at (x, z).
double skin_y_mm(const MeshQuery& face, double x, double z) {
  const auto hit = face.ray({x, -200, z}, Vector3::UnitY(), 0, 400);
  return hit ? hit->point_mm.y() : 1e9;
}

TEST(Face, HasTheReliefOfAFace) {
  for (const std::uint64_t seed : {1u, 77u, 4242u}) {
    SCOPED_TRACE(seed);
    const TriangleMesh mesh = make_face(draw_face_shape(seed));
    EXPECT_GE(mesh.triangles.size(), 60000u);
    EXPECT_LE(mesh.triangles.size(), 120000u);
    const MeshTopology topology = mesh_topology(mesh);
    EXPECT_EQ(topology.components, 1u);
    EXPECT_TRUE(topology.manifold());
    const MeshQuery face(mesh);
    // The nose's tip is the foremost point, near the midline, 25–40 mm above the incisal edge.
    Vector3 tip = mesh.vertices_mm[0];
    for (const Vector3& p : mesh.vertices_mm)
      if (p.y() < tip.y()) tip = p;
    EXPECT_LT(std::abs(tip.x()), 4.0);
    EXPECT_GT(tip.z(), 25);
    EXPECT_LT(tip.z(), 42);
    const double nasion = skin_y_mm(face, 0, 71), glabella = skin_y_mm(face, 0, 84),
                 brow = skin_y_mm(face, 24, 86);
    EXPECT_LT(glabella, nasion - 1.0) << "the root of the nose lies behind the brow";
    EXPECT_LT(tip.y(), nasion - 15) << "the nose stands out";
    EXPECT_GT(skin_y_mm(face, 24, 76), brow + 4) << "the orbits are hollow";
    EXPECT_GT(skin_y_mm(face, -24, 76), brow + 4);
    EXPECT_GT(skin_y_mm(face, 0, 140), glabella + 8) << "the forehead recedes";
    EXPECT_LT(skin_y_mm(face, 42, 46), skin_y_mm(face, 42, 72) - 2) << "cheekbones before the eye's corner";
    EXPECT_LT(skin_y_mm(face, 0, 6), -8) << "the lip covers the incisors";
    EXPECT_LT(bounding_box(mesh).min_mm.z(), 0);
  }
}

TEST(Face, SoftTissueShiftLeavesForeheadAndBridgeInPlace) {
  const TriangleMesh face = make_face(draw_face_shape(8));
  const TriangleMesh shifted = with_soft_tissue_shift(face, 0.3, 8);
  ASSERT_EQ(face.triangles, shifted.triangles);
  double largest = 0, forehead = 0, bridge = 0, lip = 0;
  for (std::size_t v = 0; v < face.vertices_mm.size(); ++v) {
    const Vector3& p = face.vertices_mm[v];
    const double moved = (shifted.vertices_mm[v] - p).norm();
    largest = std::max(largest, moved);
    if (p.z() > 80) forehead = std::max(forehead, moved);
    if (std::abs(p.x()) < 5 && p.z() > 55) bridge = std::max(bridge, moved);
    if (p.z() < 10 && std::abs(p.x()) > 25) lip = std::max(lip, moved);
  }
  EXPECT_LE(largest, 0.3 + 1e-9);
  EXPECT_LT(forehead, 0.01);
  EXPECT_LT(bridge, 0.02);
  EXPECT_GT(lip, 0.25);
}

}  // namespace
}  // namespace gnathion
