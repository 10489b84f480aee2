#include "phantom/bodies.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/mesh_query.h"
#include "phantom/bodies_field.h"
#include "phantom/bodies_head_frame.h"
#include "phantom/bodies_mesher.h"
#include "phantom/face.h"

namespace gnathion {
namespace {

TEST(Mesher, BallHasTheVolumeOfABall) {
  Box box;
  box.extend(Vector3::Constant(-13));
  box.extend(Vector3::Constant(13));
  const Vector3 centre(0.3, -0.7, 1.1);
  const TriangleMesh ball =
      mesh_of_field([&](const Vector3& p) { return field::sphere(p, centre, 10); }, box, 0.5);
  const MeshTopology topology = mesh_topology(ball);
  EXPECT_TRUE(topology.watertight());
  EXPECT_TRUE(topology.manifold());
  EXPECT_EQ(topology.genus, 0);
  EXPECT_NEAR(signed_volume_mm3(ball), 4.0 / 3.0 * std::numbers::pi * 1000, 10.0);
  for (const Vector3& p : ball.vertices_mm) ASSERT_NEAR((p - centre).norm(), 10, 1e-4);
}

TEST(Mesher, SheetsThatShareACellStayApart) {
  // Two balls that nearly touch: with one vertex a cell their surfaces would be pinched together.
  Box box;
  box.extend({-12, -6, -6});
  box.extend({12, 6, 6});
  for (const double gap : {0.05, 0.2, 0.6}) {
    const auto balls = [&](const Vector3& p) {
      return std::min(field::sphere(p, {-5 - gap / 2, 0, 0}, 5), field::sphere(p, {5 + gap / 2, 0, 0}, 5));
    };
    const MeshTopology topology = mesh_topology(mesh_of_field(balls, box, 0.5));
    EXPECT_TRUE(topology.watertight());
    EXPECT_TRUE(topology.manifold()) << gap;
  }
}

TEST(Mesher, ClippingCutsAtTheLine) {
  Box box;
  box.extend(Vector3::Constant(-13));
  box.extend(Vector3::Constant(13));
  const TriangleMesh ball =
      mesh_of_field([](const Vector3& p) { return field::sphere(p, Vector3::Zero(), 10); }, box, 0.5);
  const TriangleMesh half = clipped(ball, [](const Vector3& p) { return p.z() - 2.0; });
  EXPECT_NEAR(bounding_box(half).min_mm.z(), 2.0, 1e-9);
  EXPECT_NEAR(surface_area_mm2(half), 2 * std::numbers::pi * 10 * 8, 2.0);
  EXPECT_EQ(boundary_loops(half).size(), 1u);
}

TEST(Plates, TagIsUprightForTheViewerInFront) {
  // Untilted: the patient's left (+x) is on the viewer's right, +z is up, and the tag looks to the front
  // (-y).
  const BodyTag tag = tag_of(tag_plate(3, {1, 2, 3}, 0, 0, 0));
  EXPECT_EQ(tag.id, 3);
  EXPECT_TRUE(tag.corners_in_body_mm[0].isApprox(Vector3(-9, 2, -7)));
  EXPECT_TRUE(tag.corners_in_body_mm[1].isApprox(Vector3(11, 2, -7)));
  EXPECT_TRUE(tag.corners_in_body_mm[2].isApprox(Vector3(11, 2, 13)));
  EXPECT_TRUE(tag.corners_in_body_mm[3].isApprox(Vector3(-9, 2, 13)));
  const auto normal = [](const BodyTag& t) -> Vector3 {
    return (t.corners_in_body_mm[1] - t.corners_in_body_mm[0])
        .cross(t.corners_in_body_mm[3] - t.corners_in_body_mm[0])
        .normalized();
  };
  EXPECT_TRUE(normal(tag).isApprox(-Vector3::UnitY()));
  EXPECT_GT(normal(tag_of(tag_plate(0, {0, 0, 0}, 20, 0, 0))).x(), 0.3) << "yaw turns to the patient's left";
  EXPECT_GT(normal(tag_of(tag_plate(0, {0, 0, 0}, 0, 20, 0))).z(), 0.3) << "pitch turns upwards";
}

TEST(HeadFrame, SitsOnTheHeadWithoutEnteringIt) {
  for (const std::uint64_t seed : {41u, 42u}) {
    const FaceShape shape = draw_face_shape(seed);
    const PhantomBody frame = make_head_frame_in_dental(shape);
    const MeshTopology topology = mesh_topology(frame.surface);
    EXPECT_TRUE(topology.watertight());
    EXPECT_TRUE(topology.manifold());
    EXPECT_EQ(topology.components, 1u);
    double nearest = 1e9;
    for (const Vector3& p : frame.surface.vertices_mm)
      nearest = std::min(nearest, skin_distance_mm(shape, p));
    EXPECT_GT(nearest, 0.05);
    EXPECT_LT(nearest, 0.8) << "the pads float";
    EXPECT_GE(frame.tags.tags.size(), 8u);
  }
}

}  // namespace
}  // namespace gnathion
