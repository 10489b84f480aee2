#include "occlusion/arch.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "occlusion/crown_tops.h"
#include "occlusion/horseshoe.h"
#include "occlusion/mirror_line.h"
#include "occlusion/point_grid.h"

namespace gnathion {
namespace {

constexpr double kFacingMm = 2.5;              // "closely facing" in MI; coarse scans have edges of 1 mm
constexpr std::size_t kFacingQueries = 25000;  // vertices of a jaw that are asked; enough for a plane
constexpr std::size_t kNone = ~std::size_t{0};
constexpr double kDifferentFramesMm = 3.0;
constexpr double kCrownSlabMm = 3.0;    // behind the occlusal plane: crowns only, no palate, no base
constexpr double kBeyondPlaneMm = 2.5;  // cusps and overbite reach past the plane
constexpr const char* kWhat = "cannot orient the jaws";

/// Vertices of one jaw that lie close to the other, with their normals.
struct Facing {
  std::vector<Vector3> points, normals;
  std::size_t opposed = 0, alike = 0;  ///< pairs whose normals point against each other, or alike
};

std::vector<Vector3> used_vertices(const TriangleMesh& mesh) {
  std::vector<bool> used(mesh.vertices_mm.size(), false);
  for (const Triangle& t : mesh.triangles)
    for (const auto v : t) used[v] = true;
  std::vector<Vector3> out;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i]) out.push_back(mesh.vertices_mm[i]);
  return out;
}

Facing facing_points(const TriangleMesh& mesh, const TriangleMesh& other, double reach_mm) {
  const NeighbourGrid grid(other.vertices_mm, reach_mm);
  const std::size_t stride = mesh.vertices_mm.size() / kFacingQueries + 1;
  std::vector<std::size_t> partner(mesh.vertices_mm.size(), kNone);
  tbb::parallel_for(std::size_t{0}, partner.size() / stride, [&](std::size_t k) {
    const std::size_t i = k * stride;
    partner[i] = grid.nearest(mesh.vertices_mm[i], reach_mm).value_or(kNone);
  });
  const auto normals = vertex_normals(mesh), other_normals = vertex_normals(other);
  Facing out;
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] == kNone) continue;
    const double along = normals[i].dot(other_normals[partner[i]]);
    (along < 0.0 ? out.opposed : out.alike) += 1;
    if (along > 0.0) continue;  // the back of a thin edge, or the wall beside a tooth
    out.points.push_back(mesh.vertices_mm[i]);
    out.normals.push_back(normals[i]);
  }
  return out;
}

Vector3 mean(const std::vector<Vector3>& v) {
  Vector3 sum = Vector3::Zero();
  for (const auto& p : v) sum += p;
  return v.empty() ? sum : (sum / static_cast<double>(v.size())).eval();
}

struct Plane {
  Vector3 point, normal;
  double rms_mm = 0.0;
};

/// Principal plane, refitted three times without points beyond 2.5 rms.
Plane fit_plane(const std::vector<Vector3>& points) {
  Plane plane{mean(points), Vector3::UnitZ(), 1e9};
  for (int pass = 0; pass < 4; ++pass) {
    std::vector<Vector3> kept;
    for (const auto& p : points)
      if (pass == 0 || std::abs(plane.normal.dot(p - plane.point)) < 2.5 * plane.rms_mm + 1e-9)
        kept.push_back(p);
    const Vector3 centre = mean(kept);
    Matrix3 scatter = Matrix3::Zero();
    for (const auto& p : kept) scatter += (p - centre) * (p - centre).transpose();
    const Eigen::SelfAdjointEigenSolver<Matrix3> eigen(scatter / static_cast<double>(kept.size()));
    plane = {centre, eigen.eigenvectors().col(0), std::sqrt(std::max(0.0, eigen.eigenvalues()(0)))};
  }
  return plane;
}

/// Points of the crowns of both jaws, in the plane's own coordinates.
struct Crowns {
  std::vector<Eigen::Vector2d> maxilla, mandible;
};

struct PlaneAxes {
  Vector3 origin, x, y, z;
  Eigen::Vector2d flat(const Vector3& p) const { return {x.dot(p - origin), y.dot(p - origin)}; }
  double height(const Vector3& p) const { return z.dot(p - origin); }
};

Crowns crowns_in_plane(const std::vector<Vector3>& maxilla, const std::vector<Vector3>& mandible,
                       const PlaneAxes& axes) {
  Crowns out;
  for (const auto& p : maxilla)
    if (axes.height(p) > -kBeyondPlaneMm && axes.height(p) < kCrownSlabMm)
      out.maxilla.push_back(axes.flat(p));
  for (const auto& p : mandible)
    if (axes.height(p) < kBeyondPlaneMm && axes.height(p) > -kCrownSlabMm)
      out.mandible.push_back(axes.flat(p));
  return out;
}

std::vector<Eigen::Vector2d> thinned(const std::vector<Eigen::Vector2d>& points, std::size_t limit) {
  const std::size_t stride = points.size() / limit + 1;
  std::vector<Eigen::Vector2d> out;
  for (std::size_t i = 0; i < points.size(); i += stride) out.push_back(points[i]);
  return out;
}

struct CrudePosterior {
  Eigen::Vector2d centre;
  Opening opening;
};
Result<CrudePosterior> find_open_side(const std::vector<Eigen::Vector2d>& points) {
  const Eigen::Vector2d centre = hull_centroid(points);
  const Opening opening = find_opening(points, centre);
  const double width_deg = opening.width_rad * 180.0 / std::numbers::pi;
  if (width_deg < 35.0 || width_deg > 215.0)
    return bad_input(
        kWhat, "arch shape",
        fmt::format("the crowns do not form a horseshoe (open over {:.0f} deg): a full arch is needed",
                    width_deg));
  return CrudePosterior{centre, opening};
}

std::vector<Eigen::Vector2d> thinned_crowns(const Crowns& crowns) {
  auto points = thinned(crowns.maxilla, 4000);
  const auto lower = thinned(crowns.mandible, 4000);
  points.insert(points.end(), lower.begin(), lower.end());
  return points;
}

/// In-plane axes that turn with the meshes exactly: the principal axis of the crowns that is nearer to the
/// open side becomes y. What follows works on grids and sectors, and would otherwise feel how they lie.
Result<PlaneAxes> canonical_axes(const PlaneAxes& axes, const Crowns& crowns) {
  const auto points = thinned_crowns(crowns);
  GNATHION_TRY(const CrudePosterior crude, find_open_side(points));
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (const auto& p : points) centre += p / static_cast<double>(points.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const auto& p : points) scatter += (p - centre) * (p - centre).transpose();
  const Eigen::Matrix2d principal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(scatter).eigenvectors();
  const double angle = crude.opening.direction_rad;
  const Eigen::Vector2d open_side(std::cos(angle), std::sin(angle));
  Eigen::Vector2d y = std::abs(principal.col(0).dot(open_side)) > std::abs(principal.col(1).dot(open_side))
                          ? principal.col(0)
                          : principal.col(1);
  if (y.dot(open_side) < 0.0) y = -y;
  PlaneAxes out = axes;
  out.origin = axes.origin + centre.x() * axes.x + centre.y() * axes.y;
  out.y = (y.x() * axes.x + y.y() * axes.y).normalized();
  out.x = out.y.cross(out.z);
  return out;
}

/// Turns the in-plane axes so that x is the patient's left and y posterior, with the origin on the midline.
Result<PlaneAxes> find_midline(const PlaneAxes& axes, const Crowns& crowns) {
  const auto points = thinned_crowns(crowns);
  GNATHION_TRY(const CrudePosterior crude, find_open_side(points));
  const Eigen::Vector2d centre = crude.centre;
  const Opening opening = crude.opening;
  MirrorLine line;
  line.normal_angle_rad = opening.direction_rad - 0.5 * std::numbers::pi;
  line.offset_mm = line.normal().dot(centre);
  line = refine_mirror_line(points, line);
  if (std::abs(line.normal_angle_rad + 0.5 * std::numbers::pi - opening.direction_rad) > 0.6)
    return bad_input(kWhat, "arch shape",
                     "the two sides of the arch do not mirror each other about a midline");

  const Eigen::Vector2d n = line.normal(), posterior(-n.y(), n.x());
  const Eigen::Vector2d on_line = centre - (n.dot(centre) - line.offset_mm) * n;
  PlaneAxes out;
  out.z = axes.z;
  out.y = (posterior.x() * axes.x + posterior.y() * axes.y).normalized();
  out.x = out.y.cross(out.z);
  out.origin = axes.origin + on_line.x() * axes.x + on_line.y() * axes.y;
  return out;
}

/// Upper teeth normally overlap the lower ones on the outside all round. Where it is clearly the other way
/// round for most of the arch, the two jaws were exchanged.
Status refuse_exchanged_jaws(const Crowns& crowns) {
  const auto upper = outer_radii(crowns.maxilla, Eigen::Vector2d::Zero());
  const auto lower = outer_radii(crowns.mandible, Eigen::Vector2d::Zero());
  std::vector<double> overlap;
  for (std::size_t i = 0; i < upper.size(); ++i)
    if (std::isfinite(upper[i]) && std::isfinite(lower[i])) overlap.push_back(upper[i] - lower[i]);
  if (overlap.size() < 20) return {};
  std::sort(overlap.begin(), overlap.end());
  const double median = overlap[overlap.size() / 2];
  if (median > -0.5 || overlap[overlap.size() * 7 / 10] > 0.0) return {};
  return bad_input(
      kWhat, "upper and lower",
      fmt::format("the arch given as mandible lies outside the one given as maxilla (by {:.1f} mm): "
                  "upper given as lower?",
                  -median));
}

Result<PlaneAxes> find_occlusal_plane(const TriangleMesh& maxilla, const TriangleMesh& mandible) {
  const Facing upper = facing_points(maxilla, mandible, kFacingMm);
  const Facing lower = facing_points(mandible, maxilla, kFacingMm);
  if (upper.opposed + upper.alike == 0 && facing_points(maxilla, mandible, kDifferentFramesMm).points.empty())
    return bad_input(
        kWhat, "maxilla and mandible",
        fmt::format("nothing of one jaw lies within {:.0f} mm of the other: the jaws are in different "
                    "frames or not in MI",
                    kDifferentFramesMm));
  const bool one_flipped = upper.alike + lower.alike > upper.opposed + lower.opposed;
  if (one_flipped || upper.points.size() < 30 || lower.points.size() < 30)
    return bad_input(kWhat, "maxilla and mandible",
                     one_flipped
                         ? "the facing surfaces look the same way: one mesh has flipped normals, or the jaws "
                           "are in different frames"
                         : "too little of the jaws faces each other: the jaws are in different frames or not "
                           "in MI");
  auto facing = upper.points;
  facing.insert(facing.end(), lower.points.begin(), lower.points.end());
  Plane plane = fit_plane(facing);
  if (plane.normal.dot(mean(upper.normals) - mean(lower.normals)) > 0.0) plane.normal = -plane.normal;
  // The normals of the maxilla's facing surface now point down; the bodies behind must agree.
  const double body_mm = plane.normal.dot(mean(maxilla.vertices_mm) - mean(mandible.vertices_mm));
  if (body_mm < -1.0)
    return bad_input(kWhat, "maxilla and mandible", "both meshes have flipped normals (inside out)");
  if (body_mm < 1.0 || plane.rms_mm > 3.5)
    return bad_input(
        kWhat, "maxilla and mandible",
        fmt::format("the jaws pass through each other (facing surfaces spread {:.1f} mm about a plane): "
                    "the jaws are in different frames or not in MI",
                    plane.rms_mm));
  const Vector3 x = plane.normal.unitOrthogonal();
  return PlaneAxes{plane.point, x, plane.normal.cross(x), plane.normal};
}

}  // namespace

Result<ArchFrame> find_arch(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi) {
  GNATHION_TRY(const PlaneAxes plane, find_occlusal_plane(maxilla, mandible_mi));
  const auto upper = used_vertices(maxilla), lower = used_vertices(mandible_mi);
  GNATHION_TRY(const PlaneAxes canonical, canonical_axes(plane, crowns_in_plane(upper, lower, plane)));
  GNATHION_TRY(const PlaneAxes axes, find_midline(canonical, crowns_in_plane(upper, lower, canonical)));
  const Crowns crowns = crowns_in_plane(upper, lower, axes);
  GNATHION_CHECK_OK(refuse_exchanged_jaws(crowns));
  std::vector<Eigen::Vector2d> tops;
  for (const auto& p : crown_tops(maxilla, axes.origin, axes.z, Arch::kMaxilla)) tops.push_back(axes.flat(p));
  for (const auto& p : crown_tops(mandible_mi, axes.origin, axes.z, Arch::kMandible))
    tops.push_back(axes.flat(p));
  const auto curve = curve_through(tops);
  if (!curve) return bad_input(kWhat, "arch shape", "no arch curve can be drawn through the crowns");

  double centroid_y = 0.0;
  for (const auto& p : *curve) centroid_y += p.y() / static_cast<double>(curve->size());
  ArchFrame frame;
  frame.up = axes.z;
  frame.anterior = -axes.y;
  frame.left = axes.x;
  frame.origin_mm = axes.origin + centroid_y * axes.y;
  for (const auto& p : *curve) frame.curve_mm.push_back(axes.origin + p.x() * axes.x + p.y() * axes.y);
  frame.arch_from_dental.rotation.row(0) = axes.x;
  frame.arch_from_dental.rotation.row(1) = axes.y;
  frame.arch_from_dental.rotation.row(2) = axes.z;
  frame.arch_from_dental.translation_mm = -(frame.arch_from_dental.rotation * frame.origin_mm);
  frame.incisal_mm = ArchRuler(frame).at(0.0);
  return frame;
}

}  // namespace gnathion
