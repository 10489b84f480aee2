// Orientation, teeth, contacts and realizability on the virtual patient, whose truth is known.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "anatomy/realizability.h"
#include "core/random.h"
#include "occlusion/contacts.h"
#include "occlusion/teeth.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180.0;

/// One patient, made once; moved to an arbitrary pose, so that nothing can lean on the axes.
class TeethOfThePhantom : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    jaws_ = new PhantomJaws(make_phantom_jaws(20260));
    Random random(8);
    pose_ = Rigid3{random.rotation(), 120.0 * random.normal3()};
    maxilla_ = new TriangleMesh(transformed(pose_, jaws_->maxilla));
    mandible_ = new TriangleMesh(transformed(pose_, jaws_->mandible_mi));
    arch_ = new Result<ArchFrame>(find_arch(*maxilla_, *mandible_));
  }
  static void TearDownTestSuite() {
    delete jaws_;
    delete maxilla_;
    delete mandible_;
    delete arch_;
  }
  void SetUp() override { ASSERT_TRUE(*arch_) << arch_->error().line(); }
  static double angle_deg(const Vector3& a, const Vector3& b) {
    return std::atan2(a.cross(b).norm(), a.dot(b)) / kDeg;
  }

  static PhantomJaws* jaws_;
  static TriangleMesh *maxilla_, *mandible_;
  static Result<ArchFrame>* arch_;
  static Rigid3 pose_;
};
PhantomJaws* TeethOfThePhantom::jaws_ = nullptr;
TriangleMesh* TeethOfThePhantom::maxilla_ = nullptr;
TriangleMesh* TeethOfThePhantom::mandible_ = nullptr;
Result<ArchFrame>* TeethOfThePhantom::arch_ = nullptr;
Rigid3 TeethOfThePhantom::pose_;

// The plane through the facing surfaces need not be the patient's own (overbite tilts it), hence degrees.
TEST_F(TeethOfThePhantom, DirectionsAreThePatients) {
  const ArchFrame& arch = **arch_;
  EXPECT_LT(angle_deg(arch.up, pose_.rotation * Vector3::UnitZ()), 5.0);
  EXPECT_LT(angle_deg(arch.anterior, pose_.rotation * -Vector3::UnitY()), 5.0);
  EXPECT_LT(angle_deg(arch.left, pose_.rotation * Vector3::UnitX()), 3.0);
  const Vector3 incisal = pose_.inverse() * arch.incisal_mm;
  EXPECT_LT(incisal.norm(), 5.0) << incisal.transpose();  // the curve runs inside the upper edges
  EXPECT_LT(std::abs(incisal.x()), 1.0);
}

TEST_F(TeethOfThePhantom, CrownsGetTheirNumbers) {
  for (const Arch which : {Arch::kMaxilla, Arch::kMandible}) {
    const bool upper = which == Arch::kMaxilla;
    const auto found = assign_teeth(upper ? *maxilla_ : *mandible_, **arch_, which);
    const auto& truth = upper ? jaws_->maxilla_fdi : jaws_->mandible_fdi;
    std::size_t crown = 0, right = 0, gum = 0, wrong_gum = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      (truth[i] ? crown : gum) += 1;
      if (truth[i])
        right += found[i] == truth[i];
      else
        wrong_gum += found[i] != 0;
    }
    RecordProperty(upper ? "maxilla" : "mandible",
                   std::to_string(static_cast<double>(right) / static_cast<double>(crown)));
    EXPECT_GE(static_cast<double>(right), 0.95 * static_cast<double>(crown))
        << (upper ? "maxilla" : "mandible");
    EXPECT_LE(static_cast<double>(wrong_gum), 0.15 * static_cast<double>(gum))
        << (upper ? "maxilla" : "mandible");
  }
}

TEST_F(TeethOfThePhantom, MiHasItsContactsAndHardlyAnyOverlap) {
  const ArchFrame& arch = **arch_;
  const MeshQuery upper(*maxilla_), lower(*mandible_);
  EXPECT_LT(find_overlap(upper, lower, Rigid3::identity(), arch.up).depth_mm, 0.02);
  const auto fdi = assign_teeth(*mandible_, arch, Arch::kMandible);
  const auto contacts = find_contacts(*mandible_, fdi, Rigid3::identity(), upper, -arch.up, arch);
  int left = 0, right = 0;
  for (const auto& patch : contacts.patches) (arch.to_arch(patch.centre_mm).x() > 0 ? left : right) += 1;
  EXPECT_GE(left, 8);
  EXPECT_GE(right, 8);
  EXPECT_NEAR(contacts.left_area_mm2 + contacts.right_area_mm2, contacts.area_mm2, 1e-9);
}

TEST_F(TeethOfThePhantom, MotionsAreJudged) {
  const auto checker = RealizabilityChecker::create(*maxilla_, *mandible_);
  ASSERT_TRUE(checker) << checker.error().line();
  const Vector3 left = jaws_->landmarks.condyle_left_mm, right = jaws_->landmarks.condyle_right_mm;
  auto verdict = [&](const Rigid3& in_patient) {
    const Feasibility f = checker->check(Motion<Dental>(pose_ * in_patient * pose_.inverse()));
    std::string text = verdict_name(f.verdict);
    for (const auto& name : f.violated()) text += " " + name;
    return text;
  };
  auto shift = [](double x, double y, double z) { return Rigid3::from_translation({x, y, z}); };
  const Rigid3 open = Rigid3::about_axis(right, left - right, 4.0 * kDeg);
  EXPECT_EQ(verdict(shift(0, 0, -2) * open), "realizable");
  EXPECT_EQ(verdict(shift(0, -3, -2.5) * open), "realizable") << "opened and protruded";
  EXPECT_EQ(verdict(shift(0, 0, -0.25)), "realizable_with_apertures interocclusal_clearance");
  EXPECT_NE(verdict(shift(0, 0, 0.4)).find("no_intersection"), std::string::npos);
  EXPECT_NE(verdict(shift(0, 0, 60)).find("mandible_below_maxilla"), std::string::npos);
  EXPECT_NE(verdict(shift(0, 5, -3) * open).find("condyle_back"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
