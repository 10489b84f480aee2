#include "phantom/joints.h"

#include <gtest/gtest.h>

#include "core/mesh_query.h"
#include "core/random.h"

namespace gnathion {
namespace {

TEST(SmallestGap, OfTwoCrossedEdgesIsBetweenTheEdges) {
  TriangleMesh a, b;
  a.vertices_mm = {{-1, 0, 0}, {1, 0, 0}, {0, 0, -1}};
  b.vertices_mm = {{0, -1, 0.7}, {0, 1, 0.7}, {0, 0, 2}};
  a.triangles = b.triangles = {{0, 1, 2}};
  const SurfaceGap gap = smallest_gap(a, b);
  EXPECT_NEAR(gap.distance_mm, 0.7, 1e-12);
  EXPECT_NEAR(gap.on_a_mm.norm(), 0.0, 1e-12);
  for (Vector3& v : b.vertices_mm) v.z() -= 1.0;
  EXPECT_EQ(smallest_gap(a, b).distance_mm, 0.0);
}

TEST(PhantomJoints, DistanceAgreesWithPointsOfTheSurfaces) {
  const PhantomJoints joints = phantom_joints(make_phantom_jaws(3));
  for (const PhantomJoint* j : {&joints.left, &joints.right}) {
    // Joint spaces measure 1.5 to 3 mm (Ikeda & Kawamura 2009, CBCT of asymptomatic joints).
    EXPECT_GT(j->distance_mm, 1.0);
    EXPECT_LT(j->distance_mm, 3.0);
    const MeshQuery fossa(j->fossa);
    double by_vertices = 1e9;
    for (const Vector3& v : j->condyle.vertices_mm)
      by_vertices = std::min(by_vertices, fossa.closest(v)->distance_mm);
    EXPECT_LE(j->distance_mm, by_vertices + 1e-9);
    EXPECT_GT(j->distance_mm, by_vertices - 0.05);
    EXPECT_NEAR((j->on_condyle_mm - j->on_fossa_mm).norm(), j->distance_mm, 1e-12);
    EXPECT_NEAR((j->lateral_pole_mm - j->medial_pole_mm).norm(), 19.0, 4.0);
    EXPECT_GT(std::abs(j->lateral_pole_mm.x()), std::abs(j->medial_pole_mm.x()));
  }
}

}  // namespace
}  // namespace gnathion
