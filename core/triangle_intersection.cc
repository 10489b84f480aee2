#include "core/triangle_intersection.h"

#include <algorithm>

#include "core/triangle_predicates.h"

namespace gnathion {
namespace {

using Corners = std::array<Vector3, 3>;
using Signs = std::array<int, 3>;

/// The coordinate plane in which a triangle keeps its area, and its winding there.
struct Projection {
  int x = 0, y = 1, winding = 0;
};

Projection projection_of(const Vector3& a, const Vector3& b, const Vector3& c) {
  Projection plane;
  int k = 0;
  (b - a).cross(c - a).cwiseAbs().maxCoeff(&k);
  for (int attempt = 0; attempt < 3 && plane.winding == 0; ++attempt, ++k) {
    plane.x = (k + 1) % 3;
    plane.y = (k + 2) % 3;
    plane.winding = orient2d_sign(a, b, c, plane.x, plane.y);
  }
  return plane;
}

bool in_triangle_2d(const Vector3& p, const Corners& t, const Projection& plane) {
  for (std::size_t k = 0; k < 3; ++k)
    if (orient2d_sign(t[k], t[(k + 1) % 3], p, plane.x, plane.y) == -plane.winding) return false;
  return true;
}

/// For p on the line ab: whether it is on the segment.
bool between_2d(const Vector3& a, const Vector3& b, const Vector3& p, const Projection& plane) {
  for (int k : {plane.x, plane.y})
    if (p[k] < std::min(a[k], b[k]) || p[k] > std::max(a[k], b[k])) return false;
  return true;
}

bool segments_meet_2d(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d,
                      const Projection& plane) {
  const auto side = [&](const Vector3& p, const Vector3& q, const Vector3& r) {
    return orient2d_sign(p, q, r, plane.x, plane.y);
  };
  const int abc = side(a, b, c), abd = side(a, b, d), cda = side(c, d, a), cdb = side(c, d, b);
  if (abc * abd < 0 && cda * cdb < 0) return true;
  return (abc == 0 && between_2d(a, b, c, plane)) || (abd == 0 && between_2d(a, b, d, plane)) ||
         (cda == 0 && between_2d(c, d, a, plane)) || (cdb == 0 && between_2d(c, d, b, plane));
}

/// Segment ab, whose ends lie on the given sides of the plane of triangle t.
bool segment_meets_triangle(const Vector3& a, int a_side, const Vector3& b, int b_side, const Corners& t) {
  if (a_side * b_side > 0) return false;
  if (a_side == 0 && b_side == 0) {
    const Projection plane = projection_of(t[0], t[1], t[2]);
    if (in_triangle_2d(a, t, plane) || in_triangle_2d(b, t, plane)) return true;
    for (std::size_t k = 0; k < 3; ++k)
      if (segments_meet_2d(a, b, t[k], t[(k + 1) % 3], plane)) return true;
    return false;
  }
  // The line ab crosses the plane once: inside the triangle if it passes all sides the same way round.
  const int s0 = orient3d_sign(a, b, t[0], t[1]), s1 = orient3d_sign(a, b, t[1], t[2]);
  if (s0 * s1 < 0) return false;
  const int s2 = orient3d_sign(a, b, t[2], t[0]);
  return s2 * s0 >= 0 && s2 * s1 >= 0;
}

bool certainly_one_side(int s, int t) {
  return s == t && (s == 1 || s == -1);
}
bool in_doubt(int s) {
  return s == 0 || s == kUncertain;
}

/// Whether, seen along an axis, side k of t has the given corners strictly beyond it.
template <std::size_t n>
bool side_separates(const Corners& t, std::size_t k, const std::array<const Vector3*, n>& corners,
                    const Projection& plane) {
  for (const Vector3* corner : corners)
    if (orient2d_sign(t[k], t[(k + 1) % 3], *corner, plane.x, plane.y) != -plane.winding) return false;
  return true;
}

/// Seen along an axis, a side of one triangle has the other one beyond it. Decides cheaply between triangles
/// in nearly one plane, where signs in space would cost exact arithmetic.
bool separated_in_projection(const Corners& p, const Corners& q) {
  const Projection plane = projection_of(p[0], p[1], p[2]);
  Projection of_q = plane;
  of_q.winding = orient2d_sign(q[0], q[1], q[2], plane.x, plane.y);
  for (std::size_t k = 0; k < 3; ++k) {
    if (side_separates<3>(p, k, {&q[0], &q[1], &q[2]}, plane)) return true;
    if (of_q.winding != 0 && side_separates<3>(q, k, {&p[0], &p[1], &p[2]}, of_q)) return true;
  }
  return false;
}

/// The same for triangles with a common vertex, corner i of p: only sides through it can separate. Above
/// that vertex, p (which has area in the projection) has no other point.
bool separated_beyond_vertex(const Corners& p, std::size_t i, const Vector3& q1, const Vector3& q2) {
  const Projection plane = projection_of(p[0], p[1], p[2]);
  return side_separates<2>(p, i, {&q1, &q2}, plane) || side_separates<2>(p, (i + 2) % 3, {&q1, &q2}, plane);
}

/// Side of each of p's corners to the plane of t.
template <int (*kOrient)(const Vector3&, const Vector3&, const Vector3&, const Vector3&)>
Signs sides(const Corners& p, const Corners& t) {
  return {kOrient(t[0], t[1], t[2], p[0]), kOrient(t[0], t[1], t[2], p[1]), kOrient(t[0], t[1], t[2], p[2])};
}
bool all_on_one_side(const Signs& s) {
  return certainly_one_side(s[0], s[1]) && certainly_one_side(s[0], s[2]);
}

bool any_common_point(const Corners& p, const Corners& q) {
  Signs p_sides = sides<orient3d_filtered>(p, q), q_sides = sides<orient3d_filtered>(q, p);
  if (all_on_one_side(p_sides) || all_on_one_side(q_sides)) return false;
  if (std::any_of(p_sides.begin(), p_sides.end(), in_doubt) ||
      std::any_of(q_sides.begin(), q_sides.end(), in_doubt)) {
    if (separated_in_projection(p, q)) return false;
    p_sides = sides<orient3d_sign>(p, q);
    q_sides = sides<orient3d_sign>(q, p);
    if (all_on_one_side(p_sides) || all_on_one_side(q_sides)) return false;
  }
  // If they meet at all, a side of one meets the other.
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    if (segment_meets_triangle(p[k], p_sides[k], p[next], p_sides[next], q)) return true;
    if (segment_meets_triangle(q[k], q_sides[k], q[next], q_sides[next], p)) return true;
  }
  return false;
}

/// Corners i of p and j of q coincide. The common part is convex: if there is more of it than the vertex, it
/// reaches as a segment from there to the far side of one triangle, at a point of the other.
bool meet_beyond_vertex(const Corners& p, std::size_t i, const Corners& q, std::size_t j) {
  const Vector3 &p1 = p[(i + 1) % 3], &p2 = p[(i + 2) % 3], &q1 = q[(j + 1) % 3], &q2 = q[(j + 2) % 3];
  Signs p_sides{orient3d_filtered(q[0], q[1], q[2], p1), orient3d_filtered(q[0], q[1], q[2], p2), 0};
  if (certainly_one_side(p_sides[0], p_sides[1])) return false;
  Signs q_sides{orient3d_filtered(p[0], p[1], p[2], q1), orient3d_filtered(p[0], p[1], p[2], q2), 0};
  if (certainly_one_side(q_sides[0], q_sides[1])) return false;
  if (in_doubt(p_sides[0]) || in_doubt(p_sides[1]) || in_doubt(q_sides[0]) || in_doubt(q_sides[1])) {
    if (separated_beyond_vertex(p, i, q1, q2) || separated_beyond_vertex(q, j, p1, p2)) return false;
    p_sides = {orient3d_sign(q[0], q[1], q[2], p1), orient3d_sign(q[0], q[1], q[2], p2), 0};
    q_sides = {orient3d_sign(p[0], p[1], p[2], q1), orient3d_sign(p[0], p[1], p[2], q2), 0};
  }
  return segment_meets_triangle(p1, p_sides[0], p2, p_sides[1], q) ||
         segment_meets_triangle(q1, q_sides[0], q2, q_sides[1], p);
}

/// Corners a and b are an edge of both; c and d are the far corners. Only triangles in one plane, with c and
/// d on the same side of the edge, have more in common than the edge.
bool meet_beyond_edge(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  const int side = orient3d_filtered(a, b, c, d);
  if (!in_doubt(side)) return false;
  const Projection plane = projection_of(a, b, c);
  return orient2d_sign(a, b, d, plane.x, plane.y) == plane.winding && orient3d_sign(a, b, c, d) == 0;
}

}  // namespace

bool is_degenerate(const Vector3& a, const Vector3& b, const Vector3& c) {
  return projection_of(a, b, c).winding == 0;
}

bool triangles_intersect(const Corners& p, const Triangle& p_ids, const Corners& q, const Triangle& q_ids) {
  std::array<std::size_t, 3> in_p{}, in_q{};  // shared corners
  std::size_t shared = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (p_ids[i] == q_ids[j] && shared < 3) {
        in_p[shared] = i;
        in_q[shared] = j;
        ++shared;
      }
  if (shared == 0) return any_common_point(p, q);
  if (shared == 1) return meet_beyond_vertex(p, in_p[0], q, in_q[0]);
  if (shared == 3) return true;
  return meet_beyond_edge(p[in_p[0]], p[in_p[1]], p[3 - in_p[0] - in_p[1]], q[3 - in_q[0] - in_q[1]]);
}

}  // namespace gnathion
