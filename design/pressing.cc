#include "design/pressing.h"

#include <algorithm>
#include <array>
#include <optional>

#include "design/crossings.h"
#include "design/parallel.h"
#include "design/solid_distance.h"
#include "design/swept_depth.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kReachMm = 0.15;
constexpr double kNearMm = 0.3;         // of a jaw by coarse distances, which are never worse than this
constexpr double kAroundMm = 0.4;       // about what moved: closest points there have whole fans
constexpr double kVertexReachMm = 0.4;  // a crest's tip between the grid's nodes
constexpr double kStepMm = 0.15;        // between points that are looked at: finer than the verification's
constexpr int kRounds = 8;
constexpr double kWayMm = 12.0;  // of the seating
constexpr double kWayStepMm = 0.3;
constexpr int kWayRounds = 6;
constexpr int kAttempts = 4;  // after moves were taken back, smaller ones may do

struct Push {
  Vector3 by_mm = Vector3::Zero();
  void take(const Vector3& other) {
    if (other.squaredNorm() > by_mm.squaredNorm()) by_mm = other;
  }
};

/// The ways out of the solid for all points, zero where they are not deeper inside than the tolerance.
std::vector<Vector3> ways_out(const std::vector<Vector3>& points, const MeshQuery& solid,
                              double tolerance_mm) {
  const std::vector<SolidHit> hits = solid_hits(solid, points, kReachMm);
  std::vector<Vector3> ways(points.size(), Vector3::Zero());
  for (std::size_t i = 0; i < ways.size(); ++i)
    if (hits[i].distance_mm < -tolerance_mm) ways[i] = hits[i].point_mm - points[i];
  return ways;
}

/// Corners of the listed triangles, and points between them, that are inside the solid.
void push_triangles(const TriangleMesh& mesh, const std::vector<std::uint32_t>& triangles,
                    const MeshQuery& solid, double tolerance_mm, std::vector<Push>& pushes) {
  std::vector<std::uint32_t> corners;
  std::vector<bool> listed(mesh.triangles.size(), false);
  for (const std::uint32_t t : triangles) {
    corners.insert(corners.end(), mesh.triangles[t].begin(), mesh.triangles[t].end());
    listed[t] = true;
  }
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  const std::vector<SurfaceSample> between = sample_surface(mesh, kStepMm, listed);
  std::vector<Vector3> points;
  for (const std::uint32_t v : corners) points.push_back(mesh.vertices_mm[v]);
  for (const SurfaceSample& sample : between) points.push_back(sample.p_mm);
  const std::vector<Vector3> ways = ways_out(points, solid, tolerance_mm);
  for (std::size_t i = 0; i < corners.size(); ++i) pushes[corners[i]].take(ways[i]);
  for (std::size_t i = 0; i < between.size(); ++i)
    for (const std::uint32_t v : mesh.triangles[between[i].triangle])
      pushes[v].take(ways[corners.size() + i]);
}

/// Neighbours go half the way, so that the surface bends instead of folding.
void take_with_neighbours(const TriangleMesh& mesh, const std::vector<Push>& core,
                          std::vector<Push>& pushes) {
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t n = 1; n < 3; ++n) pushes[t[(k + n) % 3]].take(0.5 * core[t[k]].by_mm);
  for (std::size_t v = 0; v < core.size(); ++v) pushes[v].take(core[v].by_mm);
}

/// The splint, or a part of it, as jaws' vertices look at it.
struct Pierced {
  MeshQuery surface;
  std::vector<std::uint32_t> names;   ///< of its triangles in the whole mesh; empty: the same
  std::optional<Surroundings> about;  ///< vertices beyond are not looked at
  Triangle corners(const TriangleMesh& splint, std::uint32_t t) const {
    return splint.triangles[names.empty() ? t : names[t]];
  }
};

/// What moved, and so much about it that the vertices which come near find the same closest points as in the
/// whole mesh.
Pierced about_moved(const TriangleMesh& splint, const std::vector<std::uint32_t>& moved) {
  const Surroundings wide(splint, moved, 2.0 * kVertexReachMm + kAroundMm);
  std::vector<std::uint32_t> names;
  TriangleMesh part = wide.part_of(splint, names);
  return {MeshQuery(std::move(part)), std::move(names), Surroundings(splint, moved, kVertexReachMm)};
}

/// Vertices of the jaw inside the splint push the triangle that they pierced along their own normal. Returns
/// whether there were any.
bool push_by_jaw_vertices(const TriangleMesh& splint, const Pierced& pierced, const MeshQuery& jaw,
                          const std::vector<Vector3>& normals, double tolerance_mm,
                          std::vector<Push>& pushes) {
  const auto& vertices = jaw.mesh().vertices_mm;
  const Box box = bounding_box(splint);
  std::vector<std::uint32_t> inside_box;
  std::vector<Vector3> points;
  for (std::uint32_t v = 0; v < vertices.size(); ++v) {
    const Vector3& p = vertices[v];
    if ((p.array() < box.min_mm.array()).any() || (p.array() > box.max_mm.array()).any()) continue;
    if (pierced.about && !pierced.about->hold(p)) continue;
    inside_box.push_back(v);
    points.push_back(p);
  }
  const std::vector<ClosestHit> hits = closest_points(pierced.surface, points, kVertexReachMm);
  std::vector<Push> core(pushes.size());
  bool any = false;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    if (hits[i].triangle == ClosestHit::kNoTriangle || hits[i].distance_mm >= -tolerance_mm) continue;
    any = true;
    const Vector3 by_mm = -hits[i].distance_mm * normals[inside_box[i]];
    for (const std::uint32_t corner : pierced.corners(splint, hits[i].triangle)) core[corner].take(by_mm);
  }
  if (any) take_with_neighbours(splint, core, pushes);
  return any;
}

/// Corners of the listed triangles, and points between them, that would pass deeper than r in the supporting
/// arch when the seated splint leaves along -a: they go aside.
void push_on_way(const TriangleMesh& mesh, const std::vector<bool>& listed, const MeshQuery& support,
                 double engagement_mm, double tolerance_mm, std::vector<Push>& pushes) {
  std::vector<std::array<std::uint32_t, 3>> moves;  // corners that move with each point
  std::vector<Vector3> points;
  std::vector<bool> taken(mesh.vertices_mm.size(), false);
  for (std::size_t t = 0; t < listed.size(); ++t)
    if (listed[t])
      for (const std::uint32_t v : mesh.triangles[t])
        if (!taken[v]) {
          taken[v] = true;
          points.push_back(mesh.vertices_mm[v]);
          moves.push_back({v, v, v});
        }
  for (const SurfaceSample& sample : sample_surface(mesh, kWayStepMm, listed)) {
    points.push_back(sample.p_mm);
    moves.push_back(mesh.triangles[sample.triangle]);
  }
  const std::vector<SweptDepth> deep =
      depths_on_way(points, -Vector3::UnitZ(), kWayMm, support, engagement_mm + tolerance_mm);
  for (std::size_t i = 0; i < deep.size(); ++i) {
    if (deep[i].depth_mm == 0.0) continue;
    const Vector3 place = points[i] - deep[i].way_mm * Vector3::UnitZ();
    const auto out = support.closest(place, deep[i].depth_mm + tolerance_mm);
    if (!out) continue;
    const Vector3 by_mm = (1.0 - engagement_mm / deep[i].depth_mm) * (out->point_mm - place);
    for (const std::uint32_t v : moves[i]) pushes[v].take(by_mm);
  }
}

/// Vertices of the supporting arch that would pass deeper than r in the splint push it aside.
void push_on_way_by_jaw(const MeshQuery& splint, const std::vector<Vector3>& jaw_points, double engagement_mm,
                        double tolerance_mm, std::vector<Push>& pushes) {
  const std::vector<SweptDepth> deep =
      depths_on_way(jaw_points, Vector3::UnitZ(), kWayMm, splint, engagement_mm + tolerance_mm);
  std::vector<Push> core(pushes.size());
  bool any = false;
  for (const SweptDepth& one : deep) {
    if (one.depth_mm == 0.0) continue;
    const Vector3 place = one.start_mm + one.way_mm * Vector3::UnitZ();
    const auto surface = splint.closest(place, one.depth_mm + tolerance_mm);
    if (!surface) continue;
    any = true;
    const Vector3 by_mm = (1.0 - engagement_mm / one.depth_mm) * (place - surface->point_mm);
    for (const std::uint32_t corner : splint.mesh().triangles[surface->triangle]) core[corner].take(by_mm);
  }
  if (any) take_with_neighbours(splint.mesh(), core, pushes);
}

/// Makes the moves; says which vertices made one.
std::vector<char> moved_by(const std::vector<Push>& pushes, TriangleMesh& splint) {
  std::vector<char> moved(pushes.size(), 0);
  for (std::size_t v = 0; v < pushes.size(); ++v) {
    if (pushes[v].by_mm.isZero()) continue;
    splint.vertices_mm[v] += pushes[v].by_mm;
    moved[v] = 1;
  }
  return moved;
}

/// Triangles by the jaw that they may touch.
struct NearJaws {
  std::vector<std::uint32_t> support, opposing;
  bool empty() const { return support.empty() && opposing.empty(); }
};

/// Rounds of pushing until nothing is deeper than the tolerance; the mesh may cross itself afterwards.
/// `tree`: of the splint as it is, where there is one.
void press(TriangleMesh& splint, const MeshQuery& support, const MeshQuery& opposing, double tolerance_mm,
           NearJaws todo, std::optional<MeshQuery> tree) {
  const std::vector<Vector3> of_support = vertex_normals(support.mesh()),
                             of_opposing = vertex_normals(opposing.mesh());
  std::vector<std::uint32_t> moved;
  bool any_pierced = true;
  for (int round = 0; round < kRounds && (any_pierced || !todo.empty()); ++round) {
    std::vector<Push> pushes(splint.vertices_mm.size());
    push_triangles(splint, todo.support, support, tolerance_mm, pushes);
    push_triangles(splint, todo.opposing, opposing, tolerance_mm, pushes);
    if (any_pierced) {
      const Pierced pierced = round > 0 ? about_moved(splint, moved)
                              : tree    ? Pierced{std::move(*tree), {}, std::nullopt}
                                        : Pierced{MeshQuery(splint), {}, std::nullopt};
      const bool by_support =
          push_by_jaw_vertices(splint, pierced, support, of_support, tolerance_mm, pushes);
      any_pierced =
          push_by_jaw_vertices(splint, pierced, opposing, of_opposing, tolerance_mm, pushes) || by_support;
    }
    moved = triangles_at(splint, moved_by(pushes, splint));
    todo = {moved, moved};
  }
}

/// Rounds of pushing until the splint's way onto its arch meets nothing deeper than r. Returns a tree of the
/// splint as it is then, if the last round moved nothing.
std::optional<MeshQuery> press_on_way(TriangleMesh& splint, const MeshQuery& support, double engagement_mm,
                                      double tolerance_mm, const std::vector<std::uint32_t>& todo) {
  const Box box = bounding_box(splint);
  std::vector<Vector3> jaw;
  for (const Vector3& v : support.mesh().vertices_mm)
    if (v.x() > box.min_mm.x() && v.x() < box.max_mm.x() && v.y() > box.min_mm.y() && v.y() < box.max_mm.y())
      jaw.push_back(v);
  std::vector<bool> listed(splint.triangles.size(), false);
  for (const std::uint32_t t : todo) listed[t] = true;
  for (int round = 0; round < kWayRounds; ++round) {
    std::vector<Push> pushes(splint.vertices_mm.size());
    push_on_way(splint, listed, support, engagement_mm, tolerance_mm, pushes);
    MeshQuery tree(splint);
    push_on_way_by_jaw(tree, jaw, engagement_mm, tolerance_mm, pushes);
    const std::vector<std::uint32_t> moved = triangles_at(splint, moved_by(pushes, splint));
    if (moved.empty()) return tree;
    listed.assign(listed.size(), false);
    for (const std::uint32_t t : moved) listed[t] = true;
  }
  return std::nullopt;
}

/// Triangles that may come near the jaw anywhere, by its coarse distances at their corners.
std::vector<std::uint32_t> triangles_near(const TriangleMesh& mesh, const CoarseGrid& jaw) {
  std::vector<double> away(mesh.vertices_mm.size());
  parallel_each(away.size(), [&](std::size_t v) { away[v] = jaw.linear(mesh.vertices_mm[v]); });
  std::vector<std::uint32_t> near;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    const Vector3 &pa = mesh.vertices_mm[a], &pb = mesh.vertices_mm[b], &pc = mesh.vertices_mm[c];
    const double longest =
        std::sqrt(std::max({(pb - pa).squaredNorm(), (pc - pb).squaredNorm(), (pa - pc).squaredNorm()}));
    // No point of a triangle is farther from its corners than that.
    if (std::min({away[a], away[b], away[c]}) < kNearMm + longest / std::sqrt(3.0)) near.push_back(t);
  }
  return near;
}

}  // namespace

void press_free_of_jaws(TriangleMesh& splint, const SplintField& field, double tolerance_mm) {
  std::vector<char> near(splint.vertices_mm.size());
  parallel_each(near.size(), [&](std::size_t v) { near[v] = field.near_jaw(splint.vertices_mm[v], 0.0); });
  std::vector<std::uint32_t> todo = triangles_at(splint, near);
  NearJaws by_jaw{triangles_near(splint, field.jaws().support),
                  triangles_near(splint, field.jaws().opposing)};
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::vector<Vector3> sound = splint.vertices_mm;
    auto tree = press_on_way(splint, field.preparation().support, field.parameters().engagement_mm,
                             tolerance_mm, todo);
    press(splint, field.preparation().support, field.preparation().opposing, tolerance_mm, std::move(by_jaw),
          std::move(tree));
    if (!take_back_crossings(splint, sound)) return;
    std::vector<char> moved(sound.size());
    for (std::size_t v = 0; v < sound.size(); ++v) moved[v] = splint.vertices_mm[v] != sound[v];
    todo = triangles_at(splint, moved);
    by_jaw = {todo, todo};
  }
}

}  // namespace gnathion
