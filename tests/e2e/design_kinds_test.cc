// The splint's other kinds: on the mandible, on a given occlusal surface, along a sought or given direction.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "core/mesh_query.h"
#include "core/random.h"
#include "design/insertion.h"
#include "design/preparation.h"
#include "design/preview.h"
#include "design/splint.h"
#include "occlusion/contacts.h"
#include "occlusion/crowns.h"
#include "phantom/jaw_motion.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

constexpr double kVoxelMm = 0.2;

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(23);
  return instance;
}

/// Opening by 3° about the condyles, 1.5 mm forward, 0.5 mm to the left.
Motion<Dental> therapeutic() {
  const PhantomLandmarks& l = jaws().landmarks;
  const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
  const Rigid3 opening = Rigid3::about_axis(hinge, Vector3::UnitX(), 3.0 * M_PI / 180.0);
  return Motion<Dental>(Rigid3::from_translation({0.5, -1.5, 0.0}) * opening);
}

SplintInputs inputs() {
  return {jaws().maxilla, jaws().mandible_mi, therapeutic()};
}

Result<SplintDesign> designed(const SplintInputs& in, double search_deg = 15.0) {
  SplintParameters parameters;
  parameters.voxel_mm = kVoxelMm;
  parameters.insertion_search_deg = search_deg;
  SilentProgress silent;
  return design_splint(in, parameters, silent);
}

/// The plain splint, which several tests compare with.
const Result<SplintDesign>& plain_design() {
  static const Result<SplintDesign> instance = designed(inputs());
  return instance;
}

/// Deepest vertex of the solid inside the jaw's scan, and of the scan inside the solid.
double overlap_mm(const TriangleMesh& jaw, const TriangleMesh& splint) {
  const MeshQuery query(splint);
  double depth = 0.0;
  for (const Vector3& v : jaw.vertices_mm)
    if (const auto d = query.signed_distance(v, 1.0)) depth = std::max(depth, -d->distance_mm);
  return depth;
}

/// Points of the mandible that touch the maxilla in MI.
std::vector<Vector3> natural_contacts() {
  const MeshQuery maxilla(jaws().maxilla);
  std::vector<Vector3> points;
  for (const Vector3& v : jaws().mandible_mi.vertices_mm)
    if (maxilla.closest(v, 0.05)) points.push_back(v);
  return points;
}

double median_distance_mm(const std::vector<Vector3>& points, const Rigid3& motion,
                          const TriangleMesh& mesh) {
  const MeshQuery query(mesh);
  std::vector<double> distance;
  for (const Vector3& p : points) distance.push_back(query.closest(motion * p)->distance_mm);
  std::sort(distance.begin(), distance.end());
  return distance.empty() ? 1e9 : distance[distance.size() / 2];
}

TEST(MandibularSplint, StandsOnTheMandibleAndMeetsTheMaxillaInTp) {
  SplintInputs in = inputs();
  in.arch = Arch::kMandible;
  const auto design = designed(in);
  ASSERT_TRUE(design.has_value()) << design.error().line();
  EXPECT_EQ(design->verdict, "pass") << (design->violated.empty() ? "" : design->violated.front());
  // The mandible stays in MI; the maxilla comes by the inverse.
  const TriangleMesh maxilla_tp = transformed(therapeutic().rigid.inverse(), jaws().maxilla);
  EXPECT_LT(overlap_mm(jaws().mandible_mi, design->splint), 0.02);
  EXPECT_LT(overlap_mm(maxilla_tp, design->splint), 0.02);
  // It lies on the lower crowns: its centroid is below the occlusal plane's neighbourhood of the upper ones.
  const Box splint = bounding_box(design->splint);
  EXPECT_LT(splint.min_mm.z(), jaws().landmarks.lower_incisal_point_mm.z() - 2.0);
  EXPECT_LT(design->insertion.direction.z(), -0.95);
  // Contacts: maxillary teeth, on both sides, where they touched in MI.
  EXPECT_GT(design->verification.contacts.left_area_mm2, 0.5);
  EXPECT_GT(design->verification.contacts.right_area_mm2, 0.5);
  // Voxels of 0.2 mm blur the limit of 0.05 mm that makes a contact.
  EXPECT_GE(design->verification.kept_fraction, 0.85);
  for (const ToothArea& tooth : design->verification.contacts.per_tooth) EXPECT_LT(tooth.fdi, 30);
  const MeshQuery mandible(jaws().mandible_mi);
  std::vector<Vector3> touching;
  for (const Vector3& v : jaws().maxilla.vertices_mm)
    if (mandible.closest(v, 0.05)) touching.push_back(v);
  EXPECT_LT(median_distance_mm(touching, therapeutic().rigid.inverse(), design->splint), 0.03);
}

/// The crowns of the maxilla as an open surface.
TriangleMesh occlusal_surface() {
  const auto arch = find_arch(jaws().maxilla, jaws().mandible_mi);
  return region_mesh(jaws().maxilla, crown_region(jaws().maxilla, *arch, Arch::kMaxilla, 3.5));
}

TEST(GivenOcclusalSurface, OfTheCrownsGivesTheContactsOfMi) {
  SplintInputs in = inputs();
  in.occlusal_surface = occlusal_surface();
  const auto design = designed(in);
  ASSERT_TRUE(design.has_value()) << design.error().line();
  EXPECT_EQ(design->verdict, "pass") << (design->violated.empty() ? "" : design->violated.front());
  EXPECT_GE(design->verification.kept_fraction, 0.85);
  EXPECT_LT(median_distance_mm(natural_contacts(), therapeutic().rigid, design->splint), 0.03);
}

TEST(GivenOcclusalSurface, IsWhatTheMandibleMeets) {
  // Withdrawn by 0.3 mm towards the maxilla's gingiva: the splint stands off by that where jaws met in MI.
  SplintInputs in = inputs();
  in.occlusal_surface = transformed(Rigid3::from_translation({0, 0, 0.3}), occlusal_surface());
  const auto withdrawn = designed(in);
  ASSERT_TRUE(withdrawn.has_value()) << withdrawn.error().line();
  const double gap = median_distance_mm(natural_contacts(), therapeutic().rigid, withdrawn->splint);
  EXPECT_GT(gap, 0.15);  // 0.3 mm along the normal of slopes up to 60°
  EXPECT_LT(gap, 0.33);
}

TEST(GivenOcclusalSurface, InsideOutOrOfTheOtherArchIsRefused) {
  SplintInputs in = inputs();
  in.occlusal_surface = occlusal_surface();
  const auto one = prepare(in, {});
  ASSERT_TRUE(one && one->given_stamp);
  EXPECT_GT(signed_volume_mm3(one->given_stamp->mesh()), 500.0);
  for (Triangle& t : in.occlusal_surface->triangles) std::swap(t[1], t[2]);
  const auto arch = find_arch(jaws().maxilla, jaws().mandible_mi);
  const TriangleMesh lower =
      region_mesh(jaws().mandible_mi, crown_region(jaws().mandible_mi, *arch, Arch::kMandible, 2.0));
  for (const TriangleMesh& wrong : {*in.occlusal_surface, lower}) {
    in.occlusal_surface = wrong;
    const auto refused = prepare(in, {});
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().why.find("looks away"), std::string::npos) << refused.error().line();
  }
}

TEST(GivenOcclusalSurface, SmallPatchesAreExtrudedNotCapped) {
  // A hollow patch of 8 mm in a fossa: its solid reaches up to the gingiva, not across its rim.
  SplintInputs in = inputs();
  const TriangleMesh crowns = occlusal_surface();
  const Vector3 fossa = jaws().landmarks.molar_left_mm;
  std::vector<bool> near(crowns.triangles.size());
  for (std::size_t t = 0; t < near.size(); ++t)
    near[t] = (crowns.corner(t, 0) - fossa).head<2>().norm() < 4.0 && face_normal_scaled(crowns, t).z() < 0.0;
  in.occlusal_surface = submesh(crowns, near);
  const auto prepared = prepare(in, {});
  ASSERT_TRUE(prepared.has_value()) << prepared.error().line();
  EXPECT_GT(signed_volume_mm3(prepared->given_stamp->mesh()), 60.0);  // some 45 mm² by 2 mm and more
}

TEST(GivenOcclusalSurface, OfAnotherFrameOrUnitIsRefused) {
  TriangleMesh metres = occlusal_surface();
  for (Vector3& v : metres.vertices_mm) v = 0.001 * v + Vector3(0, 0, 60);
  for (const TriangleMesh& elsewhere :
       {transformed(Rigid3::from_translation({0, 0, 80}), occlusal_surface()),
        transformed(Rigid3::from_translation({150, 0, 0}), occlusal_surface()), metres}) {
    SplintInputs in = inputs();
    in.occlusal_surface = elsewhere;
    const auto design = designed(in);
    ASSERT_FALSE(design.has_value());
    EXPECT_EQ(design.error().code, ErrorCode::kInput);
    EXPECT_NE(design.error().line().find("occlusal surface"), std::string::npos) << design.error().line();
  }
}

/// Protrusion to 5 mm as a recording has it: rest, the way forward, and noise of 0.01 mm.
std::vector<Rigid3> protrusion() {
  JawGeometry joints;
  joints.condyle_left_mm = jaws().landmarks.condyle_left_mm;
  joints.condyle_right_mm = jaws().landmarks.condyle_right_mm;
  joints.condylar_inclination_rad = 25.0 * M_PI / 180.0;
  Random random(31);
  std::vector<Rigid3> out;
  for (int frame = 0; frame < 150; ++frame) {
    JawState state;
    state.slide_left_mm = state.slide_right_mm = 5.0 * std::max(0, frame - 50) / 100.0;
    const Vector3 noise = 0.01 * random.normal3();
    out.push_back(Rigid3::from_translation(noise) * motion_of(state, joints).rigid);
  }
  return out;
}

/// Deepest vertex of the jaw in the splint over all its places.
double deepest_mm(const TriangleMesh& jaw, const std::vector<Rigid3>& places, const TriangleMesh& splint) {
  const MeshQuery query(splint);
  const Box box = bounding_box(splint);
  double depth = 0.0;
  for (std::size_t n = 0; n < places.size(); n += 5)
    for (const Vector3& v : jaw.vertices_mm) {
      const Vector3 p = places[n] * v;
      if ((p.array() < box.min_mm.array()).any() || (p.array() > box.max_mm.array()).any()) continue;
      if (const auto d = query.signed_distance(p, 3.0)) depth = std::max(depth, -d->distance_mm);
    }
  return depth;
}

TEST(Freedom, TheRecordedProtrusionRunsFreeFromTp) {
  SplintInputs in = inputs();
  std::vector<Rigid3> places;  // the protrusion told anew from TP
  for (const Rigid3& r : protrusion()) places.push_back(therapeutic().rigid * r);
  const auto& held = plain_design();
  in.excursions = protrusion();
  const auto free = designed(in);
  ASSERT_TRUE(held && free);
  EXPECT_EQ(free->verdict, "pass") << (free->violated.empty() ? "" : free->violated.front());
  EXPECT_FALSE(held->verification.freedom);
  ASSERT_TRUE(free->verification.freedom);
  const double without = deepest_mm(jaws().mandible_mi, places, held->splint);
  const double with = deepest_mm(jaws().mandible_mi, places, free->splint);
  EXPECT_GT(without, 0.3);
  EXPECT_LT(with, 0.15);
  EXPECT_NEAR(free->verification.freedom->deepest_mm, with, 0.1);
  // TP itself is still held: contacts on both sides.
  EXPECT_GT(free->verification.contacts.left_area_mm2, 0.3);
  EXPECT_GT(free->verification.contacts.right_area_mm2, 0.3);
}

TEST(Freedom, OverTheMandibleTheMaxillaPasses) {
  SplintInputs in = inputs();
  in.arch = Arch::kMandible;
  in.excursions = protrusion();
  const auto free = designed(in);
  ASSERT_TRUE(free.has_value()) << free.error().line();
  std::vector<Rigid3> places;
  for (const Rigid3& r : protrusion()) places.push_back((therapeutic().rigid * r).inverse());
  EXPECT_LT(deepest_mm(jaws().maxilla, places, free->splint), 0.15);
}

/// Outermost crossing of the splint along a horizontal ray from outside, at a height of the first molar.
double buccal_mm(const TriangleMesh& splint, const Vector3& from, const Vector3& inwards) {
  const auto hit = MeshQuery(splint).ray(from, inwards);
  return hit ? hit->distance_mm : 1e9;
}

TEST(Edits, AreReplayedOverTheDesign) {
  SplintInputs in = inputs();
  const auto& plain = plain_design();
  ASSERT_TRUE(plain.has_value());
  const ArchFrame& arch = plain->arch;
  const ArchRuler ruler(arch);
  // Buccal of the left first molar: where the wall is hit from outside.
  const Vector3 outwards = ruler.outward(38.0);
  const Vector3 from = ruler.at(38.0) + 25.0 * outwards + 1.5 * arch.up;
  const Vector3 place = from - buccal_mm(plain->splint, from, -outwards) * outwards;
  Stroke add;
  add.path_mm = {place};
  add.radius_mm = 3.0;
  add.depth_mm = 0.5;
  // A window over the right second premolar, contacts on the left alone.
  const Vector3 window = ruler.at(-30.0);
  Region cutout, left;
  for (const auto& [s, b] : {std::pair(-2.0, -2.0), {2.0, -2.0}, {2.0, 2.0}, {-2.0, 2.0}})
    cutout.outline_mm.push_back(window + s * ruler.tangent(-30.0) + b * ruler.outward(-30.0));
  for (const auto& [x, y] : {std::pair(0.0, -60.0), {60.0, -60.0}, {60.0, 60.0}, {0.0, 60.0}})
    left.outline_mm.push_back(arch.origin_mm + x * arch.left + y * arch.anterior);
  in.edits.strokes = {add};
  in.edits.cutouts = {cutout};
  in.edits.contacts = {left};
  const auto edited = designed(in);
  ASSERT_TRUE(edited.has_value()) << edited.error().line();
  EXPECT_EQ(edited->verdict, "pass") << (edited->violated.empty() ? "" : edited->violated.front());

  EXPECT_NEAR(buccal_mm(plain->splint, from, -outwards) - buccal_mm(edited->splint, from, -outwards), 0.5,
              0.1);
  const Vector3 below = window - 20.0 * arch.up;
  EXPECT_TRUE(MeshQuery(plain->splint).ray(below, edited->insertion.direction));
  EXPECT_FALSE(MeshQuery(edited->splint).ray(below, edited->insertion.direction));
  ASSERT_EQ(edited->verification.apertures.size(), 1u);
  EXPECT_NEAR(edited->verification.apertures.front().area_mm2, 16.0, 0.5);
  EXPECT_GT(edited->verification.contacts.left_area_mm2, 0.8 * plain->verification.contacts.left_area_mm2);
  EXPECT_LT(edited->verification.contacts.right_area_mm2, 0.05 * plain->verification.contacts.right_area_mm2);
}

/// Volume beside the crowns that rays along −a find in the shadow of a tooth, by random points.
double shadowed_share(const MeshQuery& maxilla, const std::vector<Vector3>& beside, const Vector3& a) {
  std::size_t hit = 0;
  for (const Vector3& p : beside) hit += maxilla.ray(p, -a).has_value();
  return static_cast<double>(hit) / static_cast<double>(beside.size());
}

TEST(Insertion, LeavesLessUndercutThanTheOcclusalNormal) {
  const auto& design = plain_design();
  ASSERT_TRUE(design.has_value());
  const Insertion& found = design->insertion;
  EXPECT_LE(found.tilt_deg, 15.0 + 1e-6);
  EXPECT_LE(found.undercut_mm3, found.undercut_at_normal_mm3);
  // Independent of the grid: points within 1 mm of the crowns, in the shadow or not.
  const MeshQuery maxilla(jaws().maxilla);
  const TriangleMesh crowns = occlusal_surface();
  Random random(77);
  std::vector<Vector3> beside;
  while (beside.size() < 20000) {
    const auto v =
        static_cast<std::size_t>(random.uniform(0.0, static_cast<double>(crowns.vertices_mm.size())));
    const Vector3 p = crowns.vertices_mm[std::min(v, crowns.vertices_mm.size() - 1)] +
                      Vector3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const auto d = maxilla.signed_distance(p, 3.0);
    if (d && d->distance_mm > 0.0) beside.push_back(p);
  }
  const double along_normal = shadowed_share(maxilla, beside, design->arch.up);
  const double along_found = shadowed_share(maxilla, beside, found.direction);
  EXPECT_LE(along_found, along_normal + 0.01);
}

TEST(Insertion, IsTheGivenDirectionWhenNothingIsSought) {
  SplintParameters parameters;
  parameters.voxel_mm = kVoxelMm;
  parameters.insertion_search_deg = 0.0;
  parameters.insertion_left_deg = 4.0;
  parameters.insertion_anterior_deg = 7.0;
  for (const Arch arch : {Arch::kMaxilla, Arch::kMandible}) {
    SplintInputs in = inputs();
    in.arch = arch;
    SilentProgress silent;
    const auto design = design_splint(in, parameters, silent);
    ASSERT_TRUE(design.has_value());
    const Vector3 a = design->insertion.direction;
    const Vector3 gingival = design->arch.gingival(arch);
    EXPECT_NEAR(a.dot(design->arch.left) / a.dot(gingival), std::tan(4.0 * M_PI / 180.0), 1e-9);
    EXPECT_NEAR(a.dot(design->arch.anterior) / a.dot(gingival), std::tan(7.0 * M_PI / 180.0), 1e-9);
    EXPECT_EQ(design->verdict, "pass") << (design->violated.empty() ? "" : design->violated.front());
  }
}

TEST(Insertion, CountsTheInsideAsTheWindingNumberDoes) {
  TriangleMesh closed = jaws().condyle_left;
  const Box box = bounding_box(closed);
  GridShape shape;
  shape.spacing_mm = 0.7;
  shape.origin_mm = box.min_mm - Vector3::Constant(1.0);
  shape.nodes = ((box.size_mm() + Vector3::Constant(2.0)) / shape.spacing_mm).array().ceil().cast<int>() + 1;
  const std::vector<char> inside = nodes_inside(closed, shape);
  const MeshQuery query(closed);
  std::size_t within = 0;
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        const Vector3 p = shape.position(i, j, k);
        const auto d = query.signed_distance(p);
        if (std::abs(d->distance_mm) < 1e-3) continue;
        EXPECT_EQ(inside[shape.index(i, j, k)] != 0, d->distance_mm < 0.0) << p.transpose();
        within += d->distance_mm < 0.0;
      }
  EXPECT_GT(within, 100u);
}

/// Farthest reach of the splint along the arch: the largest tooth position with a crown vertex within 0.3 mm
/// of it, and the smallest.
std::pair<int, int> covered_positions(const TriangleMesh& splint) {
  const MeshQuery query(splint);
  std::array<int, 9> touched{};
  for (std::size_t v = 0; v < jaws().maxilla.vertices_mm.size(); v += 3)
    if (jaws().maxilla_fdi[v] != 0 && query.closest(jaws().maxilla.vertices_mm[v], 0.3))
      ++touched[jaws().maxilla_fdi[v] % 10];
  int first = 9, last = 0;
  for (int n = 1; n < 9; ++n)
    if (touched[static_cast<std::size_t>(n)] > 60) {
      first = std::min(first, n);
      last = std::max(last, n);
    }
  return {first, last};
}

TEST(Kinds, PartialCoverage) {
  const auto covering = [](double first, double last) {
    SplintParameters parameters;
    parameters.voxel_mm = kVoxelMm;
    parameters.insertion_search_deg = 0.0;
    parameters.first_tooth = first;
    parameters.last_tooth = last;
    SilentProgress silent;
    return design_splint(inputs(), parameters, silent);
  };
  const auto anterior = covering(1, 4);
  ASSERT_TRUE(anterior) << anterior.error().line();
  EXPECT_EQ(anterior->verdict, "pass") << ::testing::PrintToString(anterior->violated);
  EXPECT_EQ(anterior->verification.topology.components, 1u);
  EXPECT_EQ(covered_positions(anterior->splint), std::pair(1, 4));
  const auto posterior = covering(4, 8);
  ASSERT_TRUE(posterior) << posterior.error().line();
  EXPECT_EQ(posterior->verdict, "pass") << ::testing::PrintToString(posterior->violated);
  EXPECT_EQ(posterior->verification.topology.components, 2u);
  EXPECT_EQ(covered_positions(posterior->splint).first, 4);
}

// What the previewer remembers does not change what it makes, and that is the splint that the design makes.
TEST(Preview, IsTheSameWithAndWithoutMemoryAndLikeTheDesign) {
  SplintPreviewer remembers;
  SplintInputs in = inputs();
  SplintParameters p;
  p.voxel_mm = kVoxelMm;
  const auto both = [&](const char* what) {
    const auto again = remembers.build(in, p);
    const auto fresh = SplintPreviewer().build(in, p);
    ASSERT_TRUE(again) << again.error().line();
    ASSERT_TRUE(fresh) << fresh.error().line();
    EXPECT_EQ(again->splint.vertices_mm, fresh->splint.vertices_mm) << what;
    EXPECT_EQ(again->splint.triangles, fresh->splint.triangles) << what;
    EXPECT_TRUE(mesh_topology(again->splint).watertight()) << what;
  };
  both("first");
  const auto preview = remembers.build(in, p);
  ASSERT_TRUE(preview);
  const auto& full = plain_design();
  ASSERT_TRUE(full) << full.error().line();
  const double volume = full->verification.volume_mm3;
  EXPECT_NEAR(signed_volume_mm3(preview->splint), volume, 0.06 * volume);
  const MeshQuery design(full->splint);
  std::vector<double> off_mm;
  for (const ClosestHit& hit : closest_points(design, preview->splint.vertices_mm))
    off_mm.push_back(std::abs(hit.distance_mm));
  std::sort(off_mm.begin(), off_mm.end());
  EXPECT_LT(off_mm[off_mm.size() * 95 / 100], 0.3);

  p.wall_mm = 1.3;
  both("a thicker wall");
  EXPECT_GT(signed_volume_mm3(remembers.build(in, p)->splint), 1.05 * signed_volume_mm3(preview->splint));
  p.insertion_left_deg = 2.0;
  both("another insertion");
  in.arch = Arch::kMandible;
  both("another arch");
  const Rigid3 elsewhere = Rigid3::about_axis({10.0, 0.0, 5.0}, Vector3(1.0, 2.0, 3.0).normalized(), 0.7);
  in = {transformed(elsewhere, jaws().maxilla), transformed(elsewhere, jaws().mandible_mi),
        Motion<Dental>(elsewhere * therapeutic().rigid * elsewhere.inverse())};
  both("jaws elsewhere");
  in.therapeutic.rigid = Rigid3::from_translation({0.0, 0.0, -0.4}) * in.therapeutic.rigid;
  const auto moved = remembers.build(in, p);
  ASSERT_TRUE(moved);
  const auto fresh = SplintPreviewer().build(in, p);
  ASSERT_TRUE(fresh);
  EXPECT_NEAR(signed_volume_mm3(moved->splint), signed_volume_mm3(fresh->splint), 1e-3);  // but for rounding
}

}  // namespace
}  // namespace gnathion
