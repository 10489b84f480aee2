// What stands beside the plain splint: profiles, undercut map, sigma of the contacts, teeth corrected by
// hand, a drawn margin, a label.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <nlohmann/json.hpp>

#include "core/mesh_query.h"
#include "design/profiles.h"
#include "design/splint.h"
#include "occlusion/crowns.h"
#include "phantom/jaw_motion.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(23);
  return instance;
}

SplintInputs inputs() {
  const PhantomLandmarks& l = jaws().landmarks;
  const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
  const Rigid3 opening = Rigid3::about_axis(hinge, Vector3::UnitX(), 3.0 * M_PI / 180.0);
  SplintInputs in{jaws().maxilla, jaws().mandible_mi,
                  Motion<Dental>(Rigid3::from_translation({0.5, -1.5, 0.0}) * opening)};
  Matrix6 covariance = Matrix6::Zero();
  covariance.diagonal() << 1e-6, 1e-6, 1e-6, 4e-4, 4e-4, 9e-4;
  in.therapeutic_covariance = covariance;
  return in;
}

SplintDesign designed(const SplintInputs& in) {
  SplintParameters parameters;
  parameters.voxel_mm = 0.2;
  parameters.insertion_search_deg = 0.0;
  SilentProgress silent;
  auto design = design_splint(in, parameters, silent);
  if (!design) throw std::runtime_error(design.error().line());
  return std::move(*design);
}

const SplintDesign& plain() {
  static const SplintDesign instance = designed(inputs());
  return instance;
}

/// Label, a margin and a corrected tooth in one design: the walls that they touch lie apart.
constexpr double kMarginDepthMm = 2.5;

/// Along the left molars' buccal gingiva, 2.5 mm behind the plain splint's occlusal level instead of 4.
MarginCurve drawn_margin(const SplintInputs& in) {
  const ArchFrame& arch = plain().arch;
  const ArchRuler ruler(arch);
  const OcclusalLevel level(in.maxilla, arch, Arch::kMaxilla);
  const MeshQuery surface(in.maxilla);
  MarginCurve margin;
  for (double s = 32.0; s <= 48.0; s += 1.0) {
    // The buccal wall at that height: from outside onto the tooth.
    const Vector3 at = ruler.at(s) + (level.depth_mm(s) + kMarginDepthMm) * arch.up;
    const auto hit = surface.ray(at + 12.0 * ruler.outward(s), -ruler.outward(s));
    if (hit) margin.points_mm.push_back(at + (12.0 - hit->distance_mm) * ruler.outward(s));
  }
  return margin;
}

struct Marked {
  SplintInputs in = inputs();
  SplintDesign design;
  Marked() {
    in.edits.margins.push_back(drawn_margin(in));
    in.edits.label = "P23";
    in.edits.teeth.missing = {18, 28};
    design = designed(in);
  }
};
const Marked& marked() {
  static const Marked instance;
  return instance;
}

TEST(Profiles, StandAtEachToothWithNumbersThatAgreeWithTheMesh) {
  const SplintInputs in = inputs();
  const auto profiles = splint_profiles(in, plain());
  std::size_t teeth = 0;
  for (const SplintProfile& p : profiles) {
    teeth += p.cause.rfind("tooth ", 0) == 0;
    ASSERT_TRUE(p.wall_min_mm && p.gap_min_mm) << p.name;
    // In the plane nothing is nearer than in space.
    EXPECT_GE(*p.wall_min_mm, plain().verification.thickness.min_mm - 0.01) << p.name;
    EXPECT_NEAR((p.thinnest[0] - p.thinnest[1]).norm(), *p.wall_min_mm, 1e-9) << p.name;
    if (p.clearance_mm) {
      EXPECT_GT(*p.clearance_mm, -0.03) << p.name;
    }
    EXPECT_LE(*p.gap_min_mm, *p.gap_median_mm);
    EXPECT_LT(*p.gap_median_mm, 0.3);
    // Across the arch: the tangent of the arch curve is the plane's normal.
    EXPECT_NEAR(p.plane.x_axis.dot(p.plane.y_axis), 0.0, 1e-9);
  }
  EXPECT_GE(teeth, 12u);
  EXPECT_EQ(profiles_json(profiles).size(), profiles.size());
}

TEST(Retention, UndercutsAreWhereTheGingivaSideOfTheBulgeIsAndTheSplintHoldsNoMoreThanR) {
  const Retention& r = plain().verification.retention;
  ASSERT_EQ(r.undercut_mm.size(), jaws().maxilla.vertices_mm.size());
  // Where the map says "undercut", the way along -a leads through the tooth; where normals look at the
  // opposing arch there is none.
  const auto normals = vertex_normals(jaws().maxilla);
  std::size_t deep = 0, wrong = 0;
  for (std::size_t v = 0; v < r.undercut_mm.size(); ++v) {
    const double along = normals[v].dot(plain().insertion.direction);
    if (r.undercut_mm[v] > 0.15) ++deep;
    if (r.undercut_mm[v] > 0.15 && along < -0.5) ++wrong;
  }
  EXPECT_GT(deep, 20u);
  EXPECT_LE(wrong, deep / 50);
  EXPECT_GT(r.undercut_max_mm(), 0.1);
  // r, and what the insertability gate lets pass.
  EXPECT_LE(r.engaged_max_mm(), 0.05 + 0.05);
  double area = 0.0;
  for (const ToothRetention& t : r.per_tooth) area += t.engaged_area_mm2;
  EXPECT_NEAR(area, r.engaged_area_mm2(), 1e-9);
  EXPECT_LE(area, plain().verification.retention_area_mm2 + 1e-9);
  EXPECT_GE(area, 0.9 * plain().verification.retention_area_mm2);
}

TEST(ContactSigmas, StandAtEveryTouchingToothOfTheRealSplint) {
  const SplintVerification& v = plain().verification;
  ASSERT_TRUE(v.contact_sigma);
  ASSERT_EQ(v.contact_sigma->per_tooth.size(), v.contacts.per_tooth.size());
  ASSERT_EQ(v.contact_sigma->patches_mm.size(), v.contacts.patches.size());
  for (const ContactSigma::Tooth& tooth : v.contact_sigma->per_tooth) {
    EXPECT_GT(tooth.sigma_mm, 0.015);  // 0.02 to 0.03 mm of shift, and 0.001 rad over 30 mm
    EXPECT_LT(tooth.sigma_mm, 0.08);
    EXPECT_GE(tooth.largest_mm, tooth.sigma_mm);
  }
}

TEST(TeethByHand, KeepTheirNumbersThroughTheDesign) {
  for (const ToothRetention& t : marked().design.verification.retention.per_tooth)
    EXPECT_NE(t.fdi % 10, 8) << int(t.fdi);
  const nlohmann::json j = design_json(marked().design, {}, "test", 0.0, 0.0);
  EXPECT_EQ(j["edits"]["tooth"].size(), 2u);
  // A rebuild from what design.json keeps has the same edits.
  const auto again = parse_edits(marks_toml(marked().design.edits), "again");
  ASSERT_TRUE(again.has_value()) << again.error().line();
  EXPECT_EQ(again->teeth.missing, marked().design.edits.teeth.missing);
  EXPECT_EQ(again->label, "P23");
  EXPECT_EQ(again->margins.size(), 1u);
}

TEST(TeethByHand, ThatContradictTheJawAreRefusedByName) {
  SplintInputs in = inputs();
  in.edits.teeth.labels.push_back({26, in.maxilla.vertices_mm[0] + Vector3(200, 0, 0)});
  SplintParameters parameters;
  SilentProgress silent;
  const auto design = design_splint(in, parameters, silent);
  ASSERT_FALSE(design.has_value());
  EXPECT_NE(design.error().line().find("26"), std::string::npos) << design.error().line();
}

TEST(Margin, IsWhereTheSplintEnds) {
  ASSERT_GE(marked().in.edits.margins[0].points_mm.size(), 12u);
  const MeshQuery splint(marked().design.splint), before(plain().splint);
  // Just below the margin there is a wall; the plain splint reaches on, the trimmed one does not.
  const Vector3 up = marked().design.arch.up;
  const auto nearest = [](const MeshQuery& mesh, const Vector3& p) { return mesh.closest(p)->distance_mm; };
  const auto& points = marked().in.edits.margins[0].points_mm;
  std::size_t looked_at = 0, reached_before = 0;  // between teeth even the plain wall is far from them
  for (std::size_t i = 3; i + 3 < points.size(); ++i) {
    EXPECT_LT(nearest(splint, points[i] - 0.7 * up), 0.5) << i;
    EXPECT_GT(nearest(splint, points[i] + 1.0 * up), 0.7) << i;
    ++looked_at;
    reached_before += nearest(before, points[i] + 1.0 * up) < 0.5;
  }
  EXPECT_GT(3 * reached_before, 2 * looked_at);
}

TEST(Margin, OffTheArchIsRefusedByPoint) {
  SplintInputs in = inputs();
  in.edits.margins.push_back(drawn_margin(in));
  in.edits.margins[0].points_mm[4] += Vector3(0, 0, 40);
  SplintParameters parameters;
  SilentProgress silent;
  const auto design = design_splint(in, parameters, silent);
  ASSERT_FALSE(design.has_value());
  EXPECT_NE(design.error().line().find("margin 1, point 5"), std::string::npos) << design.error().line();
}

TEST(Label, StandsOutOfTheWallByThreeTenthsAndTouchesNothingElse) {
  ASSERT_TRUE(marked().design.label);
  const EmbossedLabel& label = *marked().design.label;
  EXPECT_EQ(label.text.substr(0, 4), "P23 ");
  EXPECT_EQ(label.text.size(), 10u);  // with the hash
  EXPECT_GE(label.letter_mm, 2.0);
  // Against the splint without a label: letters 0.3 mm proud, within the text's place.
  const MeshQuery bare(plain().splint);
  double proudest = 0.0;
  std::size_t raised = 0;
  for (const Vector3& p : marked().design.splint.vertices_mm) {
    if ((p - label.centre_mm).norm() > 0.5 * label.width_mm + 3.0) continue;
    const auto d = bare.signed_distance(p, 2.0);
    if (!d) continue;
    proudest = std::max(proudest, d->distance_mm);
    raised += d->distance_mm > 0.25;
  }
  EXPECT_GT(raised, 100u);
  EXPECT_GE(proudest, 0.3);
  EXPECT_LE(proudest, 0.5);  // 0.35, and what voxels of 0.2 mm and the grid's slope make of it
  EXPECT_EQ(marked().design.verdict, "pass")
      << (marked().design.violated.empty() ? "" : marked().design.violated.front());
}

/// Opened by 3° more than the positioning splint: the plane needs room.
struct Flat {
  SplintInputs in = inputs();
  SplintParameters parameters;
  SplintDesign design;
  Flat() {
    const PhantomLandmarks& l = jaws().landmarks;
    const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
    in.therapeutic = Motion<Dental>(Rigid3::about_axis(hinge, Vector3::UnitX(), 5.0 * M_PI / 180.0));
    parameters.voxel_mm = 0.2;
    parameters.insertion_search_deg = 0.0;
    parameters.flat_plane = 2.0;
    SilentProgress silent;
    auto made = design_splint(in, parameters, silent);
    if (!made) throw std::runtime_error(made.error().line());
    design = std::move(*made);
  }
};
const Flat& flat() {
  static const Flat instance;
  return instance;
}

TEST(FlatPlaneSplint, IsAPlaneThatTheLowerCuspsTouchInTp) {
  const SplintDesign& d = flat().design;
  EXPECT_EQ(d.verdict, "pass") << (d.violated.empty() ? "" : d.violated.front());
  ASSERT_TRUE(d.flat);
  EXPECT_GE(d.verification.contacts.per_tooth.size(), 4u);
  EXPECT_GT(d.verification.contacts.left_area_mm2, 0.05);
  EXPECT_GT(d.verification.contacts.right_area_mm2, 0.05);
  // No bearing tip goes deeper than allowed, and the deepest goes just so deep or all touch.
  double deepest = -1e9;
  for (const FlatPlane::Tip& tip : d.flat->tips())
    if (tip.fdi % 10 >= 3) deepest = std::max(deepest, tip.into_mm);
  EXPECT_LE(deepest, flat().parameters.plane_indent_mm + 1e-9);
  EXPECT_GE(deepest, 0.0);
  // The biting surface over premolars and molars: most of the stamp's vertices lie in the plane.
  const Rigid3 design_from_dental = d.dental_from_design.inverse();
  const Vector3 normal = d.dental_from_design.rotation * d.flat->normal();
  const std::vector<Vector3> normals = vertex_normals(d.splint);
  std::size_t biting = 0, in_plane = 0;
  for (std::size_t v = 0; v < d.part.size(); ++v) {
    if (d.part[v] != 2 || normals[v].dot(normal) > -0.97) continue;  // SurfacePart::kStamp, its biting side
    ++biting;
    in_plane += std::abs(d.flat->beyond_mm(design_from_dental * d.splint.vertices_mm[v])) < 0.02;
  }
  std::printf("flat: %zu of %zu biting vertices in the plane, %zu teeth touch\n", in_plane, biting,
              d.verification.contacts.per_tooth.size());
  EXPECT_GT(biting, 200u);
  EXPECT_GT(static_cast<double>(in_plane), 0.8 * static_cast<double>(biting));
  EXPECT_LT(d.verification.contact_surface_error.mean_abs_mm, 0.02);
}

TEST(FlatPlaneSplint, GuidesTheCanineUpItsRamp) {
  const SplintDesign& d = flat().design;
  const MeshQuery splint(d.splint);
  const Vector3 normal = d.dental_from_design.rotation * d.flat->normal();
  std::size_t canines = 0;
  for (const FlatPlane::Ramp& ramp : d.flat->ramps()) {
    if (ramp.fdi % 10 != 3) continue;
    ++canines;
    EXPECT_NEAR(std::atan(ramp.slope) * 180.0 / M_PI, flat().parameters.canine_ramp_deg, 1e-9);
    // A ray from the opposing side meets the ramp at its height, half way and three quarters up.
    for (const double part : {0.5, 0.75, 0.95}) {
      const Vector3 foot = d.dental_from_design * Vector3(ramp.start_mm + part * ramp.length_mm * ramp.along);
      const auto hit = splint.ray(foot - 8.0 * normal, normal);
      ASSERT_TRUE(hit.has_value()) << int(ramp.fdi);
      const double height = (foot - hit->point_mm).dot(normal);
      // The canine itself, in TP, may have taken some of it; nothing stands higher but the wall over cusps.
      EXPECT_LE(height, part * ramp.length_mm * ramp.slope + 0.05) << int(ramp.fdi) << " " << part;
      if (part > 0.7) {
        EXPECT_GT(height, 0.5 * part * ramp.length_mm * ramp.slope) << int(ramp.fdi) << " " << part;
      }
    }
  }
  EXPECT_EQ(canines, 2u);
}

/// Least distance to the splint of the lower teeth that `which` takes, the jaw moved from TP by `by`.
template <class Which>
double least_gap_mm(const MeshQuery& splint, const Vector3& by, Which which) {
  const PhantomJaws& j = jaws();
  const Rigid3 tp = flat().in.therapeutic.rigid;
  double least = 1e9;
  for (std::size_t v = 0; v < j.mandible_fdi.size(); ++v) {
    if (j.mandible_fdi[v] == 0 || !which(j.mandible_fdi[v])) continue;
    if (const auto hit = splint.signed_distance(tp * j.mandible_mi.vertices_mm[v] + by, 3.0))
      least = std::min(least, hit->distance_mm);
  }
  return least;
}

TEST(FlatPlaneSplint, ARampTakesTheOtherTeethApart) {
  const SplintDesign& d = flat().design;
  const MeshQuery splint(d.splint);
  const Vector3 into = d.dental_from_design.rotation * d.flat->normal();
  std::size_t guided = 0;
  for (const FlatPlane::Ramp& ramp : d.flat->ramps()) {
    if (ramp.fdi % 10 != 3) continue;
    // The jaw goes aside, and as far down as canines to molars ask: out of the wells of their tips, then up
    // the ramp. (An incisor that stands out beyond them is told by flat_tip_depth_mm.)
    const double way_mm = 0.5 + 0.7 * ramp.length_mm;
    const Vector3 aside = way_mm * (d.dental_from_design.rotation * ramp.along);
    double low = 0.0, high = 4.0;
    while (high - low > 0.01) {
      const double down = 0.5 * (low + high);
      (least_gap_mm(splint, aside - down * into, [](int fdi) { return fdi % 10 >= 3; }) < 0.0 ? low : high) =
          down;
    }
    const Vector3 by = aside - high * into;
    const double guide_mm = least_gap_mm(splint, by, [&](int fdi) { return fdi == int(ramp.fdi); });
    const double molars_mm = least_gap_mm(splint, by, [](int fdi) { return fdi % 10 >= 5; });
    std::printf(
        "%d guides %.2f mm aside and %.2f mm down: %.2f mm from its ramp, premolars and molars %.2f mm "
        "apart\n",
        int(ramp.fdi), way_mm, high, guide_mm, molars_mm);
    EXPECT_LT(guide_mm, 0.03) << int(ramp.fdi);
    EXPECT_GT(molars_mm, 0.2) << int(ramp.fdi);
    ++guided;
  }
  EXPECT_EQ(guided, 2u);
}

TEST(Label, ThatIsTooLongIsToldNotSqueezed) {
  EXPECT_FALSE(check_label("ÄÖ").has_value());
  EXPECT_FALSE(check_label("").has_value());
  EXPECT_FALSE(check_label(std::string(25, 'A')).has_value());
  EXPECT_TRUE(check_label("R050 G100").has_value());
}

}  // namespace
}  // namespace gnathion
