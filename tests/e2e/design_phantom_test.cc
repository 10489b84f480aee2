// The splint for the virtual patient: gates, independence of place and of the number of threads.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/mesh_query.h"
#include "core/random.h"
#include "design/splint.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(11);
  return instance;
}

/// Opening by 2.5° about the condyles, 1 mm forward.
Motion<Dental> therapeutic() {
  const PhantomLandmarks& l = jaws().landmarks;
  const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
  // About +x (patient's left) the front goes down where posterior is +y and up is +z.
  const Rigid3 opening = Rigid3::about_axis(hinge, Vector3::UnitX(), 2.5 * M_PI / 180.0);
  return Motion<Dental>(Rigid3::from_translation({0.0, -1.0, 0.0}) * opening);
}

Result<SplintDesign> designed(const Rigid3& place, double voxel_mm) {
  SplintParameters parameters;
  parameters.voxel_mm = voxel_mm;
  SilentProgress silent;
  return design_splint({transformed(place, jaws().maxilla),
                        transformed(place, jaws().mandible_mi),
                        Motion<Dental>(place * therapeutic().rigid * place.inverse()),
                        {}},
                       parameters, silent);
}

TEST(DesignPhantom, TherapeuticMotionOpensTheBite) {
  const Vector3 incisal = jaws().landmarks.lower_incisal_point_mm;
  EXPECT_LT((therapeutic() * incisal).z(), incisal.z() - 2.0);
}

TEST(DesignPhantom, PassesItsGatesAtFullResolution) {
  const auto design = designed(Rigid3::identity(), 0.1);
  ASSERT_TRUE(design.has_value()) << design.error().line();
  EXPECT_EQ(design->verdict, "pass") << (design->violated.empty() ? "" : design->violated.front());
  const SplintVerification& v = design->verification;
  EXPECT_TRUE(v.topology.watertight() && v.topology.manifold());
  EXPECT_EQ(v.self_intersections, 0u);
  EXPECT_LE(v.maxilla_penetration_mm, 0.02);
  EXPECT_LE(v.mandible_penetration_mm, 0.02);
  EXPECT_LE(v.contact_surface_error.mean_abs_mm, 0.005);
  EXPECT_LE(v.contact_surface_error.p99_mm, 0.02);
  EXPECT_GT(v.contacts.left_area_mm2, 0.5);
  EXPECT_GT(v.contacts.right_area_mm2, 0.5);
  EXPECT_GE(v.kept_fraction, 0.9);
  EXPECT_TRUE(v.apertures.empty());
  ASSERT_TRUE(v.predicted_seating) << v.seating_note;
  EXPECT_LE(v.predicted_seating->t_mm, 0.02);
  EXPECT_LE(v.predicted_seating->alpha_deg, 0.05);
  EXPECT_GT(v.predicted_seating->play_mm, 0.0);
}

TEST(DesignPhantom, TheSameSplintWhereverTheJawsLie) {
  Random random(5);
  const Rigid3 place{random.rotation(), Vector3(40, -70, 120)};
  const auto here = designed(Rigid3::identity(), 0.25);
  const auto there = designed(place, 0.25);
  ASSERT_TRUE(here && there);
  EXPECT_EQ(here->violated, there->violated);
  const MeshQuery query(here->splint);
  const Rigid3 back = place.inverse();
  double worst = 0.0;
  for (const Vector3& v : there->splint.vertices_mm)
    worst = std::max(worst, query.closest(back * v)->distance_mm);
  EXPECT_LT(worst, 0.05);
  EXPECT_NEAR(signed_volume_mm3(here->splint), signed_volume_mm3(there->splint), 5.0);
}

TEST(DesignPhantom, TheSameBytesOnAnyNumberOfThreads) {
  const auto many = designed(Rigid3::identity(), 0.25);
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const auto one = designed(Rigid3::identity(), 0.25);
  ASSERT_TRUE(many && one);
  EXPECT_EQ(many->splint.vertices_mm, one->splint.vertices_mm);
  EXPECT_EQ(many->splint.triangles, one->splint.triangles);
  EXPECT_EQ(many->verification.contacts.area_mm2, one->verification.contacts.area_mm2);
}

}  // namespace
}  // namespace gnathion
