// Gates that need a whole splint: the way onto the arch, the bite, printing; independence of place.
#include <gtest/gtest.h>

#include <cstdlib>

#include "core/mesh_query.h"
#include "core/random.h"
#include "design/preparation.h"
#include "design/printing/build_direction.h"
#include "design/splint.h"
#include "design/splint_field.h"
#include "design/swept_depth.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

constexpr double kWayMm = 12.0;

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(31);
  return instance;
}

/// Opening by 2.5° about the condyles, 1 mm forward.
Motion<Dental> therapeutic() {
  const PhantomLandmarks& l = jaws().landmarks;
  const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
  const Rigid3 opening = Rigid3::about_axis(hinge, Vector3::UnitX(), 2.5 * M_PI / 180.0);
  return Motion<Dental>(Rigid3::from_translation({0.0, -1.0, 0.0}) * opening);
}

SplintInputs inputs(const Rigid3& place = Rigid3::identity()) {
  return {transformed(place, jaws().maxilla),
          transformed(place, jaws().mandible_mi),
          Motion<Dental>(place * therapeutic().rigid * place.inverse()),
          {}};
}

SplintParameters coarse() {
  SplintParameters parameters;
  parameters.voxel_mm = 0.25;
  return parameters;
}

const SplintDesign& plain() {
  static const Result<SplintDesign> instance = [] {
    SilentProgress silent;
    return design_splint(inputs(), coarse(), silent);
  }();
  return instance.value();
}

const Gate& gate_named(const SplintDesign& design, const std::string& name) {
  for (const Gate& gate : design.gates)
    if (gate.name == name) return gate;
  ADD_FAILURE() << "no gate " << name;
  static const Gate none;
  return none;
}

TEST(SplintGates, TheWayOntoTheArchIsFreeButForTheEngagement) {
  const Gate& gate = gate_named(plain(), "insertability_mm");
  EXPECT_TRUE(gate.pass) << gate.value;
  EXPECT_TRUE(gate.blocks);
  std::printf("passes %.3f mm deep, r = %.3f mm\n", gate.value, plain().parameters.engagement_mm);
  // The splint holds: something of it passes below the height of contour.
  EXPECT_GT(gate.value, 0.0);
}

TEST(SplintGates, AWrongDirectionAndFilledUndercutsAreFound) {
  SilentProgress silent;
  const Vector3 a = plain().insertion.direction;
  const Preparation preparation = prepare(inputs(), coarse()).value();
  const Rigid3& design_from_dental = preparation.design_from_dental;
  const auto depth = [&](const SplintDesign& design, const Vector3& direction) {
    const TriangleMesh mesh = transformed(design_from_dental, design.splint);
    return deepest_on_way(mesh.vertices_mm, -(design_from_dental.rotation * direction), kWayMm,
                          preparation.support)
        .depth_mm;
  };
  const double limit = gate_named(plain(), "insertability_mm").limit;
  EXPECT_LE(depth(plain(), a), limit);
  const Vector3 across = a.cross(plain().arch.anterior).normalized();
  EXPECT_GT(depth(plain(), Eigen::AngleAxisd(12.0 * M_PI / 180.0, across) * a), limit);
  // Undercuts filled by up to 0.4 mm, judged by the limit of the plain splint.
  SplintParameters deep = coarse();
  deep.engagement_mm = 0.4;
  const auto filled = design_splint(inputs(), deep, silent);
  ASSERT_TRUE(filled) << filled.error().line();
  EXPECT_GT(depth(*filled, filled->insertion.direction), limit);
}

TEST(SplintGates, TheBiteIsThatOfThePhantom) {
  ASSERT_TRUE(plain().verification.bite);
  const BiteReadout& bite = *plain().verification.bite;
  const PhantomLandmarks& l = jaws().landmarks;
  const ArchFrame& arch = plain().arch;
  // The phantom's own landmarks along the plane that was found: the plane may tilt against its axes.
  const Vector3 apart = l.upper_incisal_point_mm - l.lower_incisal_point_mm;
  const Vector3 moved = therapeutic() * l.lower_incisal_point_mm - l.lower_incisal_point_mm;
  EXPECT_NEAR(bite.overjet_mi_mm, arch.anterior.dot(apart), 0.5);
  EXPECT_NEAR(bite.overbite_mi_mm, -arch.up.dot(apart), 0.3);
  EXPECT_NEAR(bite.vertical_mm, -arch.up.dot(moved), 0.05);
  EXPECT_NEAR(bite.overjet_mm - bite.overjet_mi_mm, -arch.anterior.dot(moved), 0.05);
  EXPECT_NEAR(bite.overbite_mm - bite.overbite_mi_mm, arch.up.dot(moved), 0.05);
  EXPECT_NEAR(bite.midline_mm, arch.left.dot(moved), 0.05);
  EXPECT_GT(bite.vertical_mm, bite.vertical_left_mm.value());
}

TEST(SplintGates, TheMouthOpensOutOfTheImprint) {
  EXPECT_TRUE(gate_named(plain(), "imprint_undercut_mm").pass);
  EXPECT_GT(plain().verification.imprint.depth_mm, 0.0);
}

TEST(SplintGates, ThicknessIsThatOfTheGate) {
  const SplintDesign& design = plain();
  ASSERT_EQ(design.thickness_mm.size(), design.splint.vertices_mm.size());
  ASSERT_EQ(design.part.size(), design.splint.vertices_mm.size());
  std::size_t walls = 0;
  for (const float t : design.thickness_mm) walls += t > 0.0f;
  EXPECT_GT(walls, design.thickness_mm.size() / 2);
}

TEST(SplintGates, ADirectionOfBuildKeepsTheCavityNearlyFree) {
  const SplintSurface surface{plain().splint, plain().thickness_mm, plain().part};
  const Vector3 a = plain().insertion.direction;
  const BuildDirection best = find_build_direction(surface, a), worst = overhang_along(surface, -a, 45.0);
  EXPECT_LT(best.cavity_overhang_mm2 + best.standing_in_cavity_mm2, 0.02 * worst.cavity_overhang_mm2);
  EXPECT_EQ(best.up, plain().verification.build.up);
}

/// The same splint, gates and contacts wherever the inputs lie. `make campaign` takes 20 places.
TEST(SplintGates, TheSameInAnyPlace) {
  const char* campaign = std::getenv("GNATHION_CAMPAIGN");
  const char* seed = std::getenv("GNATHION_SEED");
  const int places = campaign ? 20 : 1;
  Random random(seed ? std::strtoull(seed, nullptr, 10) : 17);
  const MeshQuery here(plain().splint);
  SilentProgress silent;
  double worst_of_all = 0.0;
  for (int n = 0; n < places; ++n) {
    const Rigid3 place{random.rotation(), 100.0 * random.normal3()};
    const auto there = design_splint(inputs(place), coarse(), silent);
    ASSERT_TRUE(there) << there.error().line();
    EXPECT_EQ(there->violated, plain().violated);
    ASSERT_EQ(there->gates.size(), plain().gates.size());
    for (std::size_t g = 0; g < there->gates.size(); ++g)
      EXPECT_EQ(there->gates[g].pass, plain().gates[g].pass) << there->gates[g].name;
    const Contacts &a = there->verification.contacts, &b = plain().verification.contacts;
    EXPECT_NEAR(a.area_mm2, b.area_mm2, 0.02 * b.area_mm2);
    EXPECT_EQ(a.per_tooth.size(), b.per_tooth.size());
    const Rigid3 back = place.inverse();
    double worst = 0.0;
    for (const Vector3& v : there->splint.vertices_mm)
      worst = std::max(worst, here.closest(back * v)->distance_mm);
    worst_of_all = std::max(worst_of_all, worst);
    EXPECT_LT(worst, 0.02) << "place " << n;
  }
  RecordProperty("worst_mm", std::to_string(worst_of_all));
  std::printf("%d place(s): at most %.4f mm apart\n", places, worst_of_all);
}

}  // namespace
}  // namespace gnathion
