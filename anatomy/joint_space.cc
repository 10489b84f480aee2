#include "anatomy/joint_space.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/check.h"
#include "core/mesh_query.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kSampleMm = 0.5;       // between vertices of coarse surfaces
constexpr double kHeadMm = 8.0;         // the condyle's head: this much below its top
constexpr double kFarMm = 200.0;        // beyond any joint
constexpr double kOpposedShare = 0.25;  // of the head with the fossa over or under it, to tell its side
constexpr int kStarts = 5;             // places from which the closest pair is sought
constexpr int kRounds = 40;             // of going to and fro

std::vector<Vector3> dense_points(const TriangleMesh& mesh) {
  std::vector<Vector3> points = mesh.vertices_mm;
  for (const SurfaceSample& s : sample_surface(mesh, kSampleMm)) points.push_back(s.p_mm);
  return points;
}

/// Points of one surface by their signed distance to the other in MI: a motion that moves a point by d
/// changes its distance by no more than d, so most need not be asked again.
struct PointsByDistance {
  std::vector<Vector3> point_mm;
  std::vector<double> in_mi_mm;  // ascending, at most the reach
};

PointsByDistance by_distance(const std::vector<Vector3>& points, const MeshQuery& other,
                             const Vector3& outward) {
  std::vector<double> distance =
      signed_gaps_mm(points, Rigid3::identity(), other, outward, JointQuery::kReachMm);
  for (double& d : distance) d = std::min(d, JointQuery::kReachMm);
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return distance[a] < distance[b]; });
  PointsByDistance out;
  for (const std::size_t i : order) {
    out.point_mm.push_back(points[i]);
    out.in_mi_mm.push_back(distance[i]);
  }
  return out;
}

/// What one surface's points say about the other: the nearest few, and the deepest.
struct Nearest {
  struct Start {
    double distance_mm;
    Vector3 point_mm;  // in the frame of the surface that was asked
  };
  std::vector<Start> starts;  // nearest first, free points only
  double deepest_mm = 0.0;    // of the points inside, positive
  Vector3 inside_mm = Vector3::Zero(), surface_mm = Vector3::Zero(), normal = Vector3::UnitZ();
};

/// `motion` brings the points into the other surface's frame.
Nearest nearest_of(const PointsByDistance& points, const Rigid3& motion, const MeshQuery& other,
                   const Vector3& outward) {
  Nearest out;
  double reach = JointQuery::kReachMm;
  for (std::size_t i = 0; i < points.point_mm.size(); ++i) {
    const Vector3 moved = motion * points.point_mm[i];
    const double at_least = points.in_mi_mm[i] - (moved - points.point_mm[i]).norm();
    if (at_least > reach) continue;  // still outside, and not nearest
    const auto found = other.signed_distance(moved, JointQuery::kReachMm);
    if (!found) continue;
    const bool inside =
        found->closest.on_boundary ? inside_surface(other, moved, outward) : found->distance_mm < 0.0;
    const double distance = std::abs(found->distance_mm);
    if (inside) {
      if (distance > out.deepest_mm) {
        out.deepest_mm = distance;
        out.inside_mm = moved;
        out.surface_mm = found->closest.point_mm;
        out.normal = found->closest.normal;
      }
      continue;
    }
    const auto at = std::lower_bound(out.starts.begin(), out.starts.end(), distance,
                                     [](const Nearest::Start& s, double d) { return s.distance_mm < d; });
    out.starts.insert(at, {distance, moved});
    if (out.starts.size() > static_cast<std::size_t>(kStarts)) out.starts.pop_back();
    // Others of the start places may still beat this one, by less than the samples' spacing.
    reach = std::min(reach, out.starts.front().distance_mm + kSampleMm);
  }
  return out;
}

}  // namespace

struct JointQuery::Surfaces {
  Joint joint;
  Vector3 up;
  MeshQuery condyle, fossa;
  PointsByDistance of_condyle, of_fossa;
  std::vector<Vector3> head_mm;  // vertices of the condyle's head
  JointSpace in_mi;

  Surfaces(const Joint& j, const Vector3& up_direction)
      : joint(j), up(up_direction), condyle(j.condyle), fossa(j.fossa) {}

  /// Median height of the fossa's lowest surface over the head, where there is one over or under it.
  double height_over_head_mm(const Rigid3& motion) const {
    std::vector<double> heights;
    for (const Vector3& v : head_mm) {
      const Vector3 p = motion * v;
      if (const auto hit = fossa.ray(p - kFarMm * up, up, 0.0, 2.0 * kFarMm))
        heights.push_back(hit->distance_mm - kFarMm);
    }
    if (static_cast<double>(heights.size()) < kOpposedShare * static_cast<double>(head_mm.size()))
      return kFarMm;
    const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
    std::nth_element(heights.begin(), middle, heights.end());
    return *middle;
  }

  /// From a point, to and fro between the surfaces: the distance only falls, to that of the closest pair
  /// nearby.
  JointSpace settled(Vector3 on_fossa, const Rigid3& motion, const Rigid3& back) const {
    JointSpace s;
    s.min_mm = kReachMm;
    for (int round = 0; round < kRounds; ++round) {
      const auto c = condyle.closest(back * on_fossa);
      const Vector3 on_condyle = motion * c->point_mm;
      const auto f = fossa.closest(on_condyle);
      const double gain = s.min_mm - f->distance_mm;
      if (gain > 0.0) {
        s.min_mm = f->distance_mm;
        s.condyle_mm = on_condyle;
        s.fossa_mm = f->point_mm;
      }
      on_fossa = f->point_mm;
      if (gain < 1e-7) break;
    }
    if (s.min_mm > 1e-9) s.normal = (s.condyle_mm - s.fossa_mm) / s.min_mm;
    return s;
  }
};

JointQuery::JointQuery(const Joint& joint, const Vector3& up)
    : surfaces_(std::make_unique<Surfaces>(joint, up)) {
  GNATHION_CHECK(!joint.condyle.empty() && !joint.fossa.empty());
  Surfaces& s = *surfaces_;
  s.of_condyle = by_distance(dense_points(joint.condyle), s.fossa, -up);
  s.of_fossa = by_distance(dense_points(joint.fossa), s.condyle, up);
  double top = -std::numeric_limits<double>::infinity();
  for (const Vector3& v : joint.condyle.vertices_mm) top = std::max(top, up.dot(v));
  const std::vector<Vector3> normals = vertex_normals(joint.condyle);
  for (std::size_t i = 0; i < normals.size(); ++i)
    if (top - up.dot(joint.condyle.vertices_mm[i]) < kHeadMm && normals[i].dot(up) > 0.5)
      s.head_mm.push_back(joint.condyle.vertices_mm[i]);
  s.in_mi = at(Rigid3::identity());
}
JointQuery::~JointQuery() = default;
JointQuery::JointQuery(JointQuery&&) noexcept = default;
JointQuery& JointQuery::operator=(JointQuery&&) noexcept = default;
const Joint& JointQuery::joint() const {
  return surfaces_->joint;
}
const JointSpace& JointQuery::in_mi() const {
  return surfaces_->in_mi;
}

JointSpace JointQuery::at(const Rigid3& motion) const {
  const Surfaces& s = *surfaces_;
  const Rigid3 back = motion.inverse();
  const Nearest by_condyle = nearest_of(s.of_condyle, motion, s.fossa, -s.up);
  const Nearest by_fossa = nearest_of(s.of_fossa, back, s.condyle, s.up);
  if (by_condyle.deepest_mm > 0.0 || by_fossa.deepest_mm > 0.0) {
    if (by_condyle.deepest_mm >= by_fossa.deepest_mm)
      return {-by_condyle.deepest_mm, by_condyle.inside_mm, by_condyle.surface_mm, by_condyle.normal};
    return {-by_fossa.deepest_mm, motion * by_fossa.surface_mm, motion * by_fossa.inside_mm,
            -(motion.rotation * by_fossa.normal)};
  }
  JointSpace best;
  best.min_mm = kReachMm;
  const auto look = [&](const Vector3& on_fossa) {
    const JointSpace found = s.settled(on_fossa, motion, back);
    if (found.min_mm < best.min_mm) best = found;
  };
  for (const auto& start : by_condyle.starts)
    if (const auto f = s.fossa.closest(start.point_mm)) look(f->point_mm);
  for (const auto& start : by_fossa.starts) look(motion * start.point_mm);
  // Free of bone, yet above it: gone through.
  const double height = s.head_mm.empty() ? kFarMm : s.height_over_head_mm(motion);
  if (height < 0.0) {
    best.min_mm = height;
    best.normal = -s.up;
  }
  return best;
}

std::vector<double> JointQuery::map_mm(const Rigid3& motion, double reach_mm) const {
  const Surfaces& s = *surfaces_;
  std::vector<Vector3> moved;
  for (const Vector3& v : s.joint.condyle.vertices_mm) moved.push_back(motion * v);
  const std::vector<ClosestHit> hits = closest_points(s.fossa, moved, reach_mm);
  std::vector<double> map(moved.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < map.size(); ++i)
    if (hits[i].triangle != ClosestHit::kNoTriangle && !hits[i].on_boundary) map[i] = hits[i].distance_mm;
  return map;
}

JointPair ready_joints(const Joints& joints, const Vector3& up) {
  JointPair pair;
  pair.known = joints;
  if (joints.left) pair.left.emplace(*joints.left, up);
  if (joints.right) pair.right.emplace(*joints.right, up);
  return pair;
}

std::optional<double> joint_variance_mm2(const Joints& joints, const JointSpace& space,
                                         const std::optional<Matrix6>& therapeutic_covariance) {
  if (joints.mi_assumed) return std::nullopt;
  double variance = 0.0;
  const auto along = [&](const Matrix6& covariance, const Vector3& at) {
    variance += space.normal.dot(point_covariance(covariance, at) * space.normal);
  };
  if (therapeutic_covariance) along(*therapeutic_covariance, space.condyle_mm);
  // Poses of the joints: T_th turns the condyle's only a little, which changes its error by less than that.
  if (joints.condyle_covariance) along(*joints.condyle_covariance, space.condyle_mm);
  if (joints.fossa_covariance) along(*joints.fossa_covariance, space.fossa_mm);
  if (joints.surface_sigma_mm) variance += 2.0 * *joints.surface_sigma_mm * *joints.surface_sigma_mm;
  const bool any = therapeutic_covariance || joints.condyle_covariance || joints.fossa_covariance ||
                   joints.surface_sigma_mm;
  return any ? std::optional<double>(variance) : std::nullopt;
}

}  // namespace gnathion
