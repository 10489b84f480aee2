#include "evaluation/integrity.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mesh_section.h"
#include "evaluation/planned_model.h"

namespace gnathion {
namespace {

constexpr double kFacingGapMm = 1.0;  // the splint's inside is no farther from the teeth
constexpr double kProfileStepMm = 0.25;
constexpr double kToothHalfWidthMm = 10.0;  // of a profile across one tooth
constexpr double kPrintedReachMm = 1.0;     // between a planned surface and its print
constexpr double kDepthReachMm = 2.0;
constexpr double kThickestMm = 8.0;

Spread spread_of(std::vector<double> values) {
  Spread s;
  s.n = values.size();
  if (values.empty()) return s;
  std::sort(values.begin(), values.end());
  s.min_mm = values.front();
  s.median_mm = values[values.size() / 2];
  s.max_mm = values.back();
  return s;
}

/// Each vertex's third of its triangles' area.
std::vector<double> vertex_areas(const TriangleMesh& mesh) {
  std::vector<double> area(mesh.vertices_mm.size(), 0.0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const double third = face_normal_scaled(mesh, t).norm() / 6.0;
    for (std::uint32_t v : mesh.triangles[t]) area[v] += third;
  }
  return area;
}

/// How deep the vertices of `splint` (placed by `pose`) lie in the body behind `surface`.
CollisionFigures collisions(const TriangleMesh& splint, const SurfaceDistance& surface, const Rigid3& pose,
                            double limit_mm) {
  std::vector<double> depth(splint.vertices_mm.size(), 0.0);
  surface.for_each(splint.vertices_mm, pose, kDepthReachMm, [&](std::size_t i, const SurfaceFoot& foot) {
    if (!foot.on_boundary) depth[i] = std::max(0.0, -foot.signed_mm);
  });
  const std::vector<double> area = vertex_areas(splint);
  CollisionFigures c;
  c.points = depth.size();
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (depth[i] > limit_mm) c.area_mm2 += area[i];
    if (depth[i] <= c.depth_mm) continue;
    c.depth_mm = depth[i];
    c.where_mm = pose * splint.vertices_mm[i];
  }
  return c;
}

/// Gaps between the vertices that face the maxilla and the maxilla.
Spread seat_gaps(const TriangleMesh& splint, const SurfaceDistance& maxilla, const Rigid3& pose) {
  const std::vector<Vector3> normals = vertex_normals(splint);
  std::vector<double> gap(splint.vertices_mm.size(), 1e9);
  maxilla.for_each(splint.vertices_mm, pose, kFacingGapMm, [&](std::size_t i, const SurfaceFoot& foot) {
    const bool facing = foot.normal.dot(pose.rotation * normals[i]) < -0.5;
    if (facing && !foot.on_boundary) gap[i] = foot.signed_mm;
  });
  gap.erase(std::remove(gap.begin(), gap.end(), 1e9), gap.end());
  return spread_of(std::move(gap));
}

/// Points every kProfileStepMm along the chains of a section, with their arc length.
struct Station {
  double along_mm;
  Vector3 p_mm;
};
std::vector<Station> stations(const std::vector<Polyline2>& chains, const SectionPlane& plane,
                              double half_width_mm) {
  std::vector<Station> result;
  double along = 0.0;
  for (const Polyline2& chain : chains) {
    double next = along;
    for (std::size_t i = 0; i + 1 < chain.size(); ++i) {
      const Eigen::Vector2d step = chain[i + 1] - chain[i];
      const double length = step.norm();
      for (; length > 0.0 && next < along + length; next += kProfileStepMm) {
        const Eigen::Vector2d at = chain[i] + step * ((next - along) / length);
        if (std::abs(at.x()) > half_width_mm) continue;
        result.push_back({next, plane.origin_mm + at.x() * plane.x_axis + at.y() * plane.y_axis});
      }
      along += length;
    }
  }
  return result;
}

/// The printed splint where it was found, made ready for rays.
struct Print {
  MeshQuery query;  ///< in the planned splint's place (Dental)
  Rigid3 seated;    ///< from there to where the maxilla had it
};

/// The wall behind an inner point: along −normal to where the material ends.
std::optional<double> wall_at(const MeshQuery& splint, const Vector3& p, const Vector3& normal) {
  const auto hit = splint.ray(p, -normal, 0.02, kThickestMm);
  if (!hit || hit->normal.dot(normal) > 0.0) return std::nullopt;  // no far side
  return hit->distance_mm;
}

/// Where the print has the surface that was planned at p: along the normal, facing alike, the nearest.
std::optional<Vector3> printed_at(const MeshQuery& print, const Vector3& p, const Vector3& normal) {
  std::optional<Vector3> best;
  double nearest = kPrintedReachMm;
  for (const double sign : {1.0, -1.0}) {
    double near = 0.0;
    for (int tries = 0; tries < 4; ++tries) {
      const auto hit = print.ray(p, sign * normal, near, nearest);
      if (!hit) break;
      if (hit->normal.dot(normal) > 0.5) {
        best = hit->point_mm;
        nearest = hit->distance_mm;
        break;
      }
      near = hit->distance_mm + 1e-6;
    }
  }
  return best;
}

ProfileFigures profile_of(const PlannedModel& model, const ProfilePlane& plane, const Print* print) {
  ProfileFigures f;
  f.plane = plane;
  const SectionPlane section{plane.point_mm, plane.up.cross(plane.normal), plane.up};
  const double half_width = plane.name == "palate" ? 1e9 : kToothHalfWidthMm;
  const MeshQuery& splint = model.splint().query;
  const MeshQuery& maxilla = model.maxilla().query;
  std::vector<double> gaps, walls, printed_gaps, printed_walls;
  for (const Station& s : stations(cut_mesh(*model.splint().mesh, section), section, half_width)) {
    const auto on = splint.closest(s.p_mm, 0.1);
    const auto tooth = maxilla.signed_distance(s.p_mm, kFacingGapMm);
    if (!on || !tooth || tooth->closest.on_boundary || on->normal.dot(tooth->closest.normal) > -0.3) continue;
    const std::optional<double> wall = wall_at(splint, s.p_mm, on->normal);
    if (!wall) continue;
    ProfilePoint point;
    point.along_mm = s.along_mm;
    point.point_mm = s.p_mm;
    point.planned_gap_mm = tooth->distance_mm;
    point.planned_wall_mm = *wall;
    gaps.push_back(point.planned_gap_mm);
    walls.push_back(point.planned_wall_mm);
    const std::optional<Vector3> there = print ? printed_at(print->query, s.p_mm, on->normal) : std::nullopt;
    if (there) {
      const auto gap = maxilla.signed_distance(print->seated * *there, 2.0 * kFacingGapMm);
      if (gap && !gap->closest.on_boundary) {
        point.printed_gap_mm = gap->distance_mm;
        printed_gaps.push_back(gap->distance_mm);
      }
      point.printed_wall_mm = wall_at(print->query, *there, on->normal);
      if (point.printed_wall_mm) printed_walls.push_back(*point.printed_wall_mm);
    }
    f.points.push_back(point);
  }
  f.planned_gap = spread_of(std::move(gaps));
  f.planned_wall = spread_of(std::move(walls));
  f.printed_gap = spread_of(std::move(printed_gaps));
  f.printed_wall = spread_of(std::move(printed_walls));
  return f;
}

std::optional<Vector3> crown_centre(const TriangleMesh& arch, const std::vector<std::uint8_t>& fdi,
                                    int tooth) {
  Vector3 sum = Vector3::Zero();
  std::size_t n = 0;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] == tooth) sum += arch.vertices_mm[v], ++n;
  if (n == 0) return std::nullopt;
  return sum / static_cast<double>(n);
}

}  // namespace

std::vector<ProfilePlane> standard_planes(const ArchFrame& frame, const TriangleMesh& maxilla,
                                          const std::vector<std::uint8_t>& maxilla_fdi) {
  const ArchRuler ruler(frame_of_jaw(maxilla, frame, Arch::kMaxilla));
  std::vector<ProfilePlane> planes;
  struct Tooth {
    int fdi;
    const char* name;
  };
  for (const Tooth& t : {Tooth{13, "canine_right"}, Tooth{23, "canine_left"}, Tooth{16, "molar_right"},
                         Tooth{26, "molar_left"}}) {
    const std::optional<Vector3> centre = crown_centre(maxilla, maxilla_fdi, t.fdi);
    if (centre) planes.push_back({t.name, *centre, ruler.tangent(ruler.measure(*centre).s_mm), frame.up});
  }
  const std::optional<Vector3> right = crown_centre(maxilla, maxilla_fdi, 16),
                               left = crown_centre(maxilla, maxilla_fdi, 26);
  if (right && left) planes.push_back({"palate", 0.5 * (*right + *left), frame.anterior, frame.up});
  return planes;
}

Integrity check_integrity(const PlannedModel& model, const SplintEvaluation& found,
                          const SplintScans& scans) {
  Integrity out;
  const SearchableSurface& design = model.splint();
  const SurfaceDistance& maxilla = model.maxilla().distance;
  const Rigid3 none = Rigid3::identity();
  out.planned_maxilla = collisions(*design.mesh, maxilla, none, out.collision_limit_mm);
  out.planned_mandible = collisions(*design.mesh, model.mandible().distance, none, out.collision_limit_mm);
  out.planned_seat_gap = seat_gaps(*design.mesh, maxilla, none);

  // The printed splint: the free scan where there is one (it has an inside), else the seated one.
  const ProcedureResult* splint = found.find(Procedure::kSplintVsModel);
  if (splint == nullptr) return out;
  const ProcedureResult* clearance = found.find(Procedure::kMaxillaryClearance);
  const Rigid3 seated = clearance && clearance->motion ? clearance->motion->motion.rigid : none;
  const TriangleMesh printed = transformed(splint->field.dental_from_scan, *splint->field.scan);
  out.printed_self_intersections = self_intersections(printed, 1000).size();
  if (clearance != nullptr)
    out.printed_maxilla = collisions(printed, maxilla, seated, out.collision_limit_mm);
  const ProcedureResult* sliding = found.find(Procedure::kMandibularSliding);
  if (sliding != nullptr) {
    const SurfaceDistance scanned(transformed(sliding->field.dental_from_scan, *scans.mandible));
    out.printed_mandible = collisions(printed, scanned, none, out.collision_limit_mm);
  }
  const Spread gap = seat_gaps(printed, maxilla, seated);
  if (clearance != nullptr && gap.n >= 100) out.printed_seat_gap = gap;

  const Print print{MeshQuery(printed), seated};
  for (const ProfilePlane& plane : standard_planes(model.arch(), *model.maxilla().mesh, model.maxilla_fdi()))
    out.profiles.push_back(profile_of(model, plane, &print));
  return out;
}

}  // namespace gnathion
