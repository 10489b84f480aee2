#include "occlusion/crown_tops.h"

#include "occlusion/horseshoe.h"

namespace gnathion {
namespace {

constexpr double kBehindPlaneMm = 4.0;  // fossae and a curve of Spee; the palate starts deeper
constexpr double kBeyondPlaneMm = 3.0;  // overbite
constexpr double kFacing = 0.35;        // cosine
constexpr double kStepMm = 0.5;

}  // namespace

std::vector<Vector3> crown_tops(const TriangleMesh& arch_mesh, const Vector3& origin_mm, const Vector3& up,
                                Arch which) {
  const Vector3 towards_gingiva = which == Arch::kMaxilla ? up : Vector3(-up);
  const auto normals = vertex_normals(arch_mesh);
  std::vector<Vector3> out;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const double depth = towards_gingiva.dot(arch_mesh.vertices_mm[i] - origin_mm);
    if (depth > -kBeyondPlaneMm && depth < kBehindPlaneMm && normals[i].dot(towards_gingiva) < -kFacing)
      out.push_back(arch_mesh.vertices_mm[i]);
  }
  return out;
}

std::optional<std::vector<Eigen::Vector2d>> curve_through(const std::vector<Eigen::Vector2d>& points_mm) {
  if (points_mm.size() < 100) return std::nullopt;
  return middle_curve(points_mm, {0.0, hull_centroid(points_mm).y()}, kStepMm);
}

ArchFrame frame_of_jaw(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which) {
  std::vector<Eigen::Vector2d> flat;
  for (const auto& p : crown_tops(arch_mesh, frame.origin_mm, frame.up, which)) {
    const Vector3 q = frame.to_arch(p);
    flat.emplace_back(q.x(), q.y());
  }
  ArchFrame own = frame;
  const auto curve = curve_through(flat);
  if (!curve) return own;
  own.curve_mm.clear();
  for (const auto& p : *curve) own.curve_mm.push_back(frame.dental_from_arch() * Vector3(p.x(), p.y(), 0.0));
  own.incisal_mm = ArchRuler(own).at(0.0);
  return own;
}

}  // namespace gnathion
