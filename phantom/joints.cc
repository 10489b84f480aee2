#include "phantom/joints.h"

#include <algorithm>
#include <limits>

#include "core/triangle_distance.h"
#include "core/triangle_intersection.h"

namespace gnathion {
namespace {

struct Ball {
  Vector3 centre;
  double radius;
};

std::vector<Ball> balls_of(const TriangleMesh& mesh) {
  std::vector<Ball> balls(mesh.triangles.size());
  for (std::size_t t = 0; t < balls.size(); ++t) {
    balls[t].centre = (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    balls[t].radius = 0.0;
    for (int k = 0; k < 3; ++k)
      balls[t].radius = std::max(balls[t].radius, (mesh.corner(t, k) - balls[t].centre).norm());
  }
  return balls;
}

/// Closest points of the segments ab and cd (Ericson, Real-Time Collision Detection, 5.1.9).
void closest_on_segments(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d,
                         Vector3* on_ab, Vector3* on_cd) {
  const Vector3 u = b - a, v = d - c, w = a - c;
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), uw = u.dot(w), vw = v.dot(w);
  const double det = uu * vv - uv * uv;
  double s = det > 1e-14 * uu * vv ? std::clamp((uv * vw - uw * vv) / det, 0.0, 1.0) : 0.0;
  double t = vv > 0.0 ? (uv * s + vw) / vv : 0.0;
  if (t < 0.0 || t > 1.0) {
    t = std::clamp(t, 0.0, 1.0);
    s = uu > 0.0 ? std::clamp((uv * t - uw) / uu, 0.0, 1.0) : 0.0;
  }
  *on_ab = a + s * u;
  *on_cd = c + t * v;
}

void take_smaller(const Vector3& on_a, const Vector3& on_b, SurfaceGap& gap) {
  const double d = (on_a - on_b).norm();
  if (d < gap.distance_mm) gap = {d, on_a, on_b};
}

/// Disjoint triangles are nearest at a corner of one of them or between two edges.
void take_pair(const std::array<Vector3, 3>& p, const std::array<Vector3, 3>& q, SurfaceGap& gap) {
  if (!is_degenerate(p[0], p[1], p[2]) && !is_degenerate(q[0], q[1], q[2]) &&
      triangles_intersect(p, {0, 1, 2}, q, {3, 4, 5})) {
    const Vector3 middle = (p[0] + p[1] + p[2]) / 3.0;
    gap = {0.0, middle, middle};
    return;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    take_smaller(p[k], closest_on_triangle(p[k], q[0], q[1], q[2]).point_mm, gap);
    take_smaller(closest_on_triangle(q[k], p[0], p[1], p[2]).point_mm, q[k], gap);
    for (std::size_t l = 0; l < 3; ++l) {
      Vector3 on_p, on_q;
      closest_on_segments(p[k], p[(k + 1) % 3], q[l], q[(l + 1) % 3], &on_p, &on_q);
      take_smaller(on_p, on_q, gap);
    }
  }
}

/// The ends of the head's longest diameter; the head is what lies above 3 mm under its centre.
void set_poles(const Vector3& centre, bool left, PhantomJoint& joint) {
  std::vector<Vector3> head;
  for (const Vector3& v : joint.condyle.vertices_mm)
    if (v.z() > centre.z() - 3.0) head.push_back(v);
  double longest = -1.0;
  for (std::size_t i = 0; i < head.size(); ++i)
    for (std::size_t j = i + 1; j < head.size(); ++j) {
      const double d = (head[i] - head[j]).squaredNorm();
      if (d <= longest) continue;
      longest = d;
      const bool i_is_medial = left ? head[i].x() < head[j].x() : head[i].x() > head[j].x();
      joint.medial_pole_mm = i_is_medial ? head[i] : head[j];
      joint.lateral_pole_mm = i_is_medial ? head[j] : head[i];
    }
}

PhantomJoint joint_of(const TriangleMesh& condyle, const TriangleMesh& fossa, const Vector3& centre,
                      bool left) {
  PhantomJoint joint;
  joint.condyle = condyle;
  joint.fossa = fossa;
  set_poles(centre, left, joint);
  const SurfaceGap gap = smallest_gap(condyle, fossa);
  joint.distance_mm = gap.distance_mm;
  joint.on_condyle_mm = gap.on_a_mm;
  joint.on_fossa_mm = gap.on_b_mm;
  return joint;
}

}  // namespace

SurfaceGap smallest_gap(const TriangleMesh& a, const TriangleMesh& b) {
  SurfaceGap gap{std::numeric_limits<double>::infinity(), Vector3::Zero(), Vector3::Zero()};
  const std::vector<Ball> of_a = balls_of(a), of_b = balls_of(b);
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    for (std::size_t j = 0; j < of_b.size(); ++j) {
      const double reach = gap.distance_mm + of_a[i].radius + of_b[j].radius;
      if (!((of_a[i].centre - of_b[j].centre).squaredNorm() < reach * reach)) continue;
      take_pair({a.corner(i, 0), a.corner(i, 1), a.corner(i, 2)},
                {b.corner(j, 0), b.corner(j, 1), b.corner(j, 2)}, gap);
      if (gap.distance_mm == 0.0) return gap;
    }
  }
  return gap;
}

PhantomJoints phantom_joints(const PhantomJaws& jaws) {
  return {joint_of(jaws.condyle_left, jaws.fossa_left, jaws.landmarks.condyle_left_mm, true),
          joint_of(jaws.condyle_right, jaws.fossa_right, jaws.landmarks.condyle_right_mm, false)};
}

}  // namespace gnathion
