#include "phantom/jaws.h"

#include <cmath>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "core/mesh_query.h"
#include "phantom/jaws_bite.h"

namespace gnathion {
namespace {

constexpr std::uint64_t kSeeds[] = {11, 4242};

const PhantomJaws& jaws_of(std::uint64_t seed) {
  static std::map<std::uint64_t, PhantomJaws> made;
  const auto found = made.find(seed);
  return found != made.end() ? found->second : made.emplace(seed, make_phantom_jaws(seed)).first->second;
}

class Jaws : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Jaws, testing::ValuesIn(kSeeds));

void expect_scan_like(const TriangleMesh& mesh) {
  const MeshTopology t = mesh_topology(mesh);
  EXPECT_TRUE(t.manifold());
  EXPECT_EQ(t.components, 1u);
  EXPECT_EQ(t.degenerate_triangles, 0u);
  EXPECT_EQ(boundary_loops(mesh).size(), 1u);
  EXPECT_GE(t.triangles, 150000u);
  EXPECT_LE(t.triangles, 250000u);
  EXPECT_TRUE(self_intersections(mesh, 5).empty());
}

TEST_P(Jaws, SurfacesAreSound) {
  const PhantomJaws& j = jaws_of(GetParam());
  expect_scan_like(j.maxilla);
  expect_scan_like(j.mandible_mi);
  // Outward: above the mandible's crowns lies air, and the winding number inside a crown is near 1.
  const Vector3 inside = j.landmarks.molar_left_mm - Vector3(0, 0, 2.0);
  EXPECT_GT(MeshQuery(j.mandible_mi).winding_number(inside), 0.6);
  EXPECT_GT(MeshQuery(j.maxilla).winding_number(Vector3(0, 1.0, 4.0)), 0.6);
}

TEST_P(Jaws, MeetWithoutOverlap) {
  const PhantomBite bite = measure_bite(jaws_of(GetParam()));
  EXPECT_GE(bite.left, 8);
  EXPECT_GE(bite.right, 8);
  EXPECT_LE(bite.overlap_mm, 0.02);
  // Every back tooth carries, and none is ironed onto its antagonist.
  std::map<int, double> area;
  for (const BiteContact& c : bite.contacts) area[c.lower_fdi] += c.area_mm2;
  for (const int fdi : {34, 35, 36, 37, 44, 45, 46, 47}) {
    EXPECT_GT(area[fdi], 0.0) << fdi;
    EXPECT_LT(area[fdi], 12.0) << fdi;
  }
}

// Overlap told by an independent way: no triangle of one jaw crosses one of the other.
TEST_P(Jaws, DoNotCross) {
  const PhantomJaws& j = jaws_of(GetParam());
  TriangleMesh apart = j.mandible_mi;
  for (Vector3& v : apart.vertices_mm) v.z() -= 0.02;
  EXPECT_TRUE(intersections(j.maxilla, apart, 5).empty());
}

TEST_P(Jaws, AllTeethAreLabelledInOrder) {
  const PhantomJaws& j = jaws_of(GetParam());
  ASSERT_EQ(j.maxilla_fdi.size(), j.maxilla.vertices_mm.size());
  ASSERT_EQ(j.mandible_fdi.size(), j.mandible_mi.vertices_mm.size());
  for (const bool upper : {true, false}) {
    const auto& mesh = upper ? j.maxilla : j.mandible_mi;
    const auto& fdi = upper ? j.maxilla_fdi : j.mandible_fdi;
    std::map<int, std::pair<Vector3, int>> sum;
    for (std::size_t i = 0; i < fdi.size(); ++i) {
      auto& [total, n] = sum.try_emplace(fdi[i], Vector3::Zero(), 0).first->second;
      total += mesh.vertices_mm[i];
      ++n;
    }
    EXPECT_EQ(sum.size(), 15u);  // 14 teeth and the gingiva
    EXPECT_GT(sum[0].second, 20000);
    for (const int quadrant : upper ? std::array{1, 2} : std::array{4, 3}) {
      const double side = quadrant == 2 || quadrant == 3 ? 1.0 : -1.0;
      double y = -100.0;
      for (int number = 1; number <= 7; ++number) {
        const auto& [total, n] = sum[10 * quadrant + number];
        ASSERT_GT(n, 800) << 10 * quadrant + number;
        const Vector3 centre = total / n;
        EXPECT_GT(side * centre.x(), 0.0);
        EXPECT_GT(centre.y(), y - 0.3);  // each behind the one before
        y = centre.y();
      }
    }
  }
}

/// The tip of a crown: its vertex farthest along `direction`.
Vector3 tip(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi, int tooth,
            const Vector3& direction) {
  Vector3 best = Vector3::Zero();
  double most = -1e9;
  for (std::size_t i = 0; i < fdi.size(); ++i) {
    if (fdi[i] != tooth || mesh.vertices_mm[i].dot(direction) <= most) continue;
    most = mesh.vertices_mm[i].dot(direction);
    best = mesh.vertices_mm[i];
  }
  return best;
}

/// How far the occlusal `depth_mm` of a crown reach sideways; `up` is the sign of z towards its cusps.
double outermost_near_cusps(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi, int tooth,
                            double side, double up, double depth_mm) {
  const double top = up * tip(mesh, fdi, tooth, {0, 0, up}).z();
  double most = -1e9;
  for (std::size_t i = 0; i < fdi.size(); ++i) {
    const Vector3& v = mesh.vertices_mm[i];
    if (fdi[i] == tooth && up * v.z() > top - depth_mm) most = std::max(most, side * v.x());
  }
  return most;
}

TEST_P(Jaws, RelationOfTheJawsIsNormal) {
  const PhantomJaws& j = jaws_of(GetParam());
  const PhantomLandmarks& l = j.landmarks;
  EXPECT_EQ(l.upper_incisal_point_mm, Vector3::Zero());
  EXPECT_GT(l.lower_incisal_point_mm.y(), 1.2);  // overjet
  EXPECT_LT(l.lower_incisal_point_mm.y(), 3.8);
  EXPECT_GT(l.lower_incisal_point_mm.z(), 1.2);  // overbite
  EXPECT_LT(l.lower_incisal_point_mm.z(), 4.0);
  // The landmarks lie on the surfaces.
  EXPECT_LT(MeshQuery(j.maxilla).closest(l.upper_incisal_point_mm)->distance_mm, 1.0);
  EXPECT_LT(MeshQuery(j.mandible_mi).closest(l.molar_left_mm)->distance_mm, 0.1);
  EXPECT_LT(MeshQuery(j.mandible_mi).closest(l.molar_right_mm)->distance_mm, 0.1);
  // The upper canine's tip stands between the lower canine's and first premolar's, and outside of them.
  for (const int side : {1, -1}) {
    const int upper = side > 0 ? 20 : 10, lower = side > 0 ? 30 : 40;
    const Vector3 u3 = tip(j.maxilla, j.maxilla_fdi, upper + 3, {0, 0, -1});
    const Vector3 l3 = tip(j.mandible_mi, j.mandible_fdi, lower + 3, {0, 0, 1});
    const Vector3 l4 = tip(j.mandible_mi, j.mandible_fdi, lower + 4, {0, 0, 1});
    const Vector3 way = (l4 - l3).normalized();
    const double along = (u3 - l3).dot(way) / (l4 - l3).norm();
    EXPECT_GT(along, 0.1);
    EXPECT_LT(along, 0.9);
    // The upper buccal cusps stand outside the lower ones.
    for (int n = 4; n <= 7; ++n) {
      EXPECT_GT(outermost_near_cusps(j.maxilla, j.maxilla_fdi, upper + n, side, -1.0, 2.5),
                outermost_near_cusps(j.mandible_mi, j.mandible_fdi, lower + n, side, 1.0, 1.5) + 0.3)
          << n;
    }
  }
}

TEST_P(Jaws, JointsFit) {
  const PhantomJaws& j = jaws_of(GetParam());
  for (const bool left : {true, false}) {
    const TriangleMesh& condyle = left ? j.condyle_left : j.condyle_right;
    const TriangleMesh& fossa = left ? j.fossa_left : j.fossa_right;
    const Vector3 centre = left ? j.landmarks.condyle_left_mm : j.landmarks.condyle_right_mm;
    EXPECT_TRUE(mesh_topology(condyle).watertight());
    EXPECT_TRUE(mesh_topology(condyle).manifold());
    EXPECT_EQ(mesh_topology(fossa).components, 1u);
    EXPECT_GT(signed_volume_mm3(condyle), 500.0);
    const MeshQuery bone(fossa);
    double space = 1e9;
    for (const Vector3& v : condyle.vertices_mm)
      space = std::min(space, bone.signed_distance(v)->distance_mm);
    EXPECT_GT(space, 0.8);  // joint space
    EXPECT_LT(space, 3.0);
    EXPECT_GT(std::abs(centre.x()), 45.0);
  }
  const double between = (j.landmarks.condyle_left_mm - j.landmarks.condyle_right_mm).norm();
  EXPECT_NEAR(between, 102.0, 10.0);
}

TEST(JawsSeeds, TheSameSeedGivesTheSameBytesAndAnotherAnotherPatient) {
  const PhantomJaws again = make_phantom_jaws(kSeeds[0]);
  const PhantomJaws &first = jaws_of(kSeeds[0]), &other = jaws_of(kSeeds[1]);
  EXPECT_EQ(again.maxilla.vertices_mm, first.maxilla.vertices_mm);
  EXPECT_EQ(again.mandible_mi.vertices_mm, first.mandible_mi.vertices_mm);
  EXPECT_EQ(again.mandible_mi.triangles, first.mandible_mi.triangles);
  EXPECT_GT((other.landmarks.molar_left_mm - first.landmarks.molar_left_mm).norm(), 0.2);
  const MeshQuery query(first.maxilla);
  double apart = 0.0;
  int teeth = 0;
  for (std::size_t i = 0; i < other.maxilla.vertices_mm.size(); i += 50) {
    if (other.maxilla_fdi[i] == 0) continue;
    apart += query.closest(other.maxilla.vertices_mm[i])->distance_mm;
    ++teeth;
  }
  EXPECT_GT(apart / teeth, 0.2);
}

}  // namespace
}  // namespace gnathion
