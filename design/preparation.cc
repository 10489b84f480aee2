#include "design/preparation.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "design/gates.h"
#include "design/insertion.h"
#include "design/label.h"
#include "design/parallel.h"
#include "design/tooth_corrections.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kBandHalfWidthMm = 9.0;  // crowns lie this near to the arch curve
constexpr double kFragmentShare = 0.02;
constexpr int kNormalRadiusRings = 2;  // smoothing passes of the normals that tell stops from walls

std::vector<Vector3> smoothed_normals(const TriangleMesh& mesh) {
  std::vector<Vector3> normals = vertex_normals(mesh);
  for (int pass = 0; pass < kNormalRadiusRings; ++pass) {
    std::vector<Vector3> sum = normals;
    for (const Triangle& t : mesh.triangles)
      for (std::size_t k = 0; k < 3; ++k) sum[t[k]] += normals[t[(k + 1) % 3]] + normals[t[(k + 2) % 3]];
    for (std::size_t i = 0; i < sum.size(); ++i) {
      const double length = sum[i].norm();
      normals[i] = length > 1e-12 ? Vector3(sum[i] / length) : Vector3(Vector3::UnitZ());
    }
  }
  return normals;
}

/// How far the faces about each convex vertex turn away from its normal: 0 up to 32°, 1 from 60° on.
std::vector<double> sharpness(const TriangleMesh& mesh) {
  const std::vector<Vector3> at_vertex = vertex_normals(mesh), at_face = face_normals(mesh);
  std::vector<double> least(at_vertex.size(), 1.0), bulge(at_vertex.size(), 0.0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t v = mesh.triangles[t][static_cast<std::size_t>(k)];
      least[v] = std::min(least[v], at_face[t].dot(at_vertex[v]));
      bulge[v] += at_vertex[v].dot(2.0 * mesh.corner(t, k) - mesh.corner(t, (k + 1) % 3) -
                                   mesh.corner(t, (k + 2) % 3));
    }
  for (std::size_t v = 0; v < least.size(); ++v)
    least[v] = bulge[v] > 0.0 ? std::clamp((0.85 - least[v]) / 0.35, 0.0, 1.0) : 0.0;
  return least;
}

/// Without loose fragments: pieces of less than 2 % of the surface, which scanners leave inside and beside
/// teeth.
TriangleMesh without_fragments(const TriangleMesh& mesh, const std::string& name,
                               std::vector<std::string>& warnings) {
  std::size_t count = 0;
  const std::vector<std::uint32_t> piece = triangle_components(mesh, &count);
  std::vector<double> area(count, 0.0);
  for (std::size_t t = 0; t < piece.size(); ++t) area[piece[t]] += 0.5 * face_normal_scaled(mesh, t).norm();
  double total = 0.0;
  for (const double a : area) total += a;
  std::vector<bool> keep(piece.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = area[piece[t]] >= kFragmentShare * total;
  const auto dropped =
      std::count_if(area.begin(), area.end(), [&](double a) { return a < kFragmentShare * total; });
  if (dropped == 0) return mesh;
  warnings.push_back(fmt::format("{}: {} loose fragments left out", name, dropped));
  return submesh(mesh, keep);
}

/// The arc that the parameters ask for, from the teeth that are there.
Result<CoveredArc> covered_arc(const TriangleMesh& support, const std::vector<std::uint8_t>& fdi,
                               const ArchFrame& arch, Arch which, const SplintParameters& p) {
  const ArchRuler ruler(arch);
  const int first = static_cast<int>(std::lround(p.first_tooth)),
            last = static_cast<int>(std::lround(p.last_tooth));
  std::array<std::vector<double>, 2> s;  // of covered teeth, right and left
  std::array<int, 2> outermost = {0, 0};
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    if (fdi[v] == 0) continue;
    const int quadrant = fdi[v] / 10, position = fdi[v] % 10;
    const std::size_t side = quadrant == 1 || quadrant == 4 ? 0 : 1;
    outermost[side] = std::max(outermost[side], position);
    if (position < first || position > last) continue;
    s[side].push_back(ruler.measure(support.vertices_mm[v]).s_mm);
  }
  CoveredArc arc;
  const bool all = first <= 1 && last >= 8;
  if (s[0].size() + s[1].size() < 100) {
    if (all) return arc;
    return bad_input("cannot design", which == Arch::kMaxilla ? "maxilla" : "mandible",
                     fmt::format("no teeth {} to {} found to cover", first, last));
  }
  if (!all && (s[0].size() < 50 || s[1].size() < 50))
    return bad_input("cannot design", which == Arch::kMaxilla ? "maxilla" : "mandible",
                     fmt::format("teeth {} to {} found on one side only", first, last));
  for (auto& side : s) std::sort(side.begin(), side.end());
  // Stray labels do not count.
  const auto low = [](const std::vector<double>& v) { return v[v.size() / 250]; };
  const auto high = [](const std::vector<double>& v) { return v[v.size() - 1 - v.size() / 250]; };
  if (all) {
    std::vector<double> both = s[0];
    both.insert(both.end(), s[1].begin(), s[1].end());
    std::sort(both.begin(), both.end());
    const std::size_t few = both.size() / 500;
    arc.right_mm = both[few];
    arc.left_mm = both[both.size() - 1 - few];
    return arc;
  }
  arc.right_mm = low(s[0]);
  arc.left_mm = high(s[1]);
  arc.right_last = outermost[0] <= last;
  arc.left_last = outermost[1] <= last;
  if (first > 1) {
    arc.right_front_mm = high(s[0]);
    arc.left_front_mm = low(s[1]);
  }
  return arc;
}

/// z along `a`, y as far posterior as that allows, origin on the occlusal plane.
Rigid3 frame_along(const Vector3& a, const ArchFrame& arch) {
  const Vector3 back = -arch.anterior;
  const Vector3 y = (back - back.dot(a) * a).normalized();
  Rigid3 frame;
  frame.rotation.row(0) = y.cross(a);
  frame.rotation.row(1) = y;
  frame.rotation.row(2) = a;
  frame.translation_mm = -(frame.rotation * arch.origin_mm);
  return frame;
}

/// The seating direction, told in Dental.
Insertion insertion_of(const TriangleMesh& support_dental, const ArchFrame& arch, Arch which,
                       const CoveredArc& covered, const SplintParameters& p,
                       const std::vector<MarginCurve>& margins) {
  const Rigid3 upright = frame_along(arch.gingival(which), arch);
  const TriangleMesh support =
      closed_to_solid(transformed(upright, support_dental), Vector3::UnitZ(), nullptr);
  const OcclusalMap level(support, arch, upright, covered);
  Insertion insertion = find_insertion(support, level, which, p, margins, upright);
  insertion.direction = upright.rotation.transpose() * insertion.direction;
  return insertion;
}

/// Crown vertices: near the arch curve and no deeper than `depth_mm` behind the local level.
Box crown_box(const TriangleMesh& support, const OcclusalMap& level, double depth_mm) {
  Box box;
  for (const Vector3& v : support.vertices_mm)
    if (std::abs(level.off_curve_mm(v)) < kBandHalfWidthMm && v.z() < level.level_mm(v) + depth_mm)
      box.extend(v);
  return box;
}

/// The next of evenly spaced margins, so that sizes about the defaults need the same one.
double widened(double margin_mm, double room_mm) {
  constexpr double kOne_mm = 1.4;  // of them: 6.2 mm is the next but one, where the defaults need 5.0
  if (!(room_mm > 0.0)) return margin_mm;
  return kOne_mm + room_mm * std::ceil((margin_mm - kOne_mm) / room_mm);
}

/// Room for the crowns, their image in TP, the shell and its fillets.
GridShape design_box(const TriangleMesh& support, const OcclusalMap& level, const Rigid3& tp_from_mi,
                     const SplintParameters& p, double spacing_mm, double room_mm) {
  const Box crowns = crown_box(support, level, p.depth_mm);
  Box box = crowns;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3 v(corner & 1 ? crowns.max_mm.x() : crowns.min_mm.x(),
                    corner & 2 ? crowns.max_mm.y() : crowns.min_mm.y(),
                    corner & 4 ? crowns.min_mm.z() + p.stamp_height_mm + 2.0 : crowns.min_mm.z());
    box.extend(tp_from_mi * v);
  }
  const double margin = widened(p.wall_mm + p.gap_mm + p.smoothing_mm + 4 * spacing_mm, room_mm);
  box.min_mm -= Vector3::Constant(margin);
  box.max_mm += Vector3(margin, margin, 0.0);
  box.max_mm.z() = std::max(box.max_mm.z(), crowns.max_mm.z()) + 4 * spacing_mm;
  GridShape shape;
  shape.spacing_mm = spacing_mm;
  // Whole multiples of the spacing, so that grids of one patient lie alike whatever T_th is.
  const double step = std::max(1.0, std::round(room_mm / spacing_mm)) * spacing_mm;
  for (int d = 0; d < 3; ++d) {
    const double low = std::floor(box.min_mm[d] / step) * step;
    const double high = std::ceil(box.max_mm[d] / step) * step;
    shape.origin_mm[d] = low;
    shape.nodes[d] = static_cast<int>(std::lround((high - low) / spacing_mm)) + 1;
  }
  return shape;
}

/// Tells where the arch leaves a flat plane no room for the wall: above the opposing tips.
void warn_of_room(const Preparation& p, double wall_mm, std::vector<std::string>& warnings) {
  const auto ours = [](const std::string& w) { return w.rfind("flat plane: ", 0) == 0; };  // of the last call
  warnings.erase(std::remove_if(warnings.begin(), warnings.end(), ours), warnings.end());
  constexpr double kAroundTipMm = 2.5, kWorthTellingMm = 0.1;
  double least = 1e300;
  for (const Vector3& v : p.support.mesh().vertices_mm)
    for (const FlatPlane::Tip& tip : p.flat->tips())
      if ((v - tip.p_mm).head<2>().norm() < kAroundTipMm)
        least = std::min(least, p.flat->normal().dot(v - p.flat->point_mm()));
  if (least < wall_mm - kWorthTellingMm)
    warnings.push_back(fmt::format(
        "flat plane: {:.1f} mm between it and the teeth, the wall needs {:.1f}: not flat there, open further",
        least, wall_mm));
}

/// Tells which incisors the plane, laid for canines to molars, lets sink into wells.
void warn_of_wells(const FlatPlane& plane, double indent_mm, std::vector<std::string>& warnings) {
  for (const FlatPlane::Tip& tip : plane.tips())
    if (tip.into_mm > indent_mm + kFlatTipToleranceMm)
      warnings.push_back(
          fmt::format("flat plane: tooth {} stands {:.1f} mm in it and is held in a well there: not flat, "
                      "to be ground free",
                      tip.fdi, tip.into_mm));
}

/// Coarse spacing and box; the voxel decides how many fine ones make a coarse one.
Status set_grid(const SplintInputs& inputs, const SplintParameters& parameters, const PreparationGrid& grid,
                Preparation& p) {
  // 0.3 mm, or 0.4 for voxels of 0.2: the small term settles halves.
  p.refinement = std::max(1, static_cast<int>(std::lround(grid.spacing_mm / parameters.voxel_mm + 0.01)));
  const std::vector<MarginCurve>& margins = inputs.edits.margins;
  GNATHION_CHECK_OK(check_margins(margins, p.design_from_dental, p.support, p.level));
  SplintParameters sized = parameters;  // room down to the deepest margin, and out to the ramps' ends
  if (is_flat(parameters))
    sized.smoothing_mm += 2.0 + std::max(parameters.canine_ramp_mm, parameters.anterior_ramp_mm);
  sized.depth_mm = std::max(parameters.depth_mm, deepest_margin_mm(margins, p.design_from_dental, p.level));
  p.coarse = design_box(p.support.mesh(), p.level, p.tp_from_mi, sized, parameters.voxel_mm * p.refinement,
                        grid.room_mm);
  if ((p.coarse.nodes.array() < 8).any() || (p.coarse.nodes.array() > 2000).any())
    return bad_input("cannot design", inputs.on_maxilla() ? "maxilla" : "mandible",
                     "no crowns found near the arch curve");
  p.margin = MarginSurface(margins, p.design_from_dental, p.coarse);
  p.label_texts = label_texts(inputs, parameters);
  p.flat.reset();
  if (is_flat(parameters)) {
    GNATHION_TRY(p.flat, FlatPlane::fitted(inputs, p.opposing_fdi, p.arch, p.design_from_dental, p.tp_from_mi,
                                           p.level, parameters));
    warn_of_room(p, parameters.wall_mm + parameters.gap_mm, p.warnings);
    warn_of_wells(*p.flat, parameters.plane_indent_mm, p.warnings);
  }
  return {};
}

constexpr double kStampHoleMm = 4.0;   // wider openings are rims of patches
constexpr double kStampReachMm = 6.0;  // a given S_occ lies this near to the crowns

/// The given S_occ as a solid: extruded towards the gingiva. It must face the opposing arch.
Result<TriangleMesh> stamp_solid(const TriangleMesh& surface_dental, const Rigid3& design_from_dental,
                                 const Box& crowns) {
  TriangleMesh surface = transformed(design_from_dental, surface_dental);
  const auto refuse = [](const char* why) { return bad_input("cannot design", "occlusal surface", why); };
  if (surface.empty()) return refuse("it has no triangles");
  const Box box = bounding_box(surface);
  const Vector3 apart = (box.min_mm - crowns.max_mm).cwiseMax(crowns.min_mm - box.max_mm).cwiseMax(0.0);
  if (apart.norm() > kStampReachMm) return refuse("it lies far from the crowns: another frame or unit?");
  if (mesh_topology(surface).watertight()) {
    if (signed_volume_mm3(surface) < 0.0) return refuse("its normals point inwards");
    return surface;
  }
  double facing = 0.0;  // area towards the opposing arch, less the area that looks away
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) facing -= face_normal_scaled(surface, t).z();
  if (facing <= 0.0) return refuse("it looks away from the opposing arch: inside out, or of the other arch");
  TriangleMesh solid = closed_to_solid(surface, Vector3::UnitZ(), nullptr, kStampHoleMm);
  if (signed_volume_mm3(solid) <= 0.0) return refuse("it encloses nothing: patches with mixed normals?");
  return solid;
}

}  // namespace

Result<Preparation> prepare(const SplintInputs& inputs, const SplintParameters& parameters,
                            const PreparationGrid& grid, const NamedJaws* known) {
  NamedJaws found;
  if (!known) {
    GNATHION_TRY(found, name_jaws(inputs.maxilla, inputs.mandible_mi, inputs.edits.teeth));
  }
  const NamedJaws& jaws = known ? *known : found;
  GNATHION_CHECK_OK(check_tooth_corrections(inputs, jaws));
  ArchFrame arch = jaws.arch;
  std::vector<std::string> warnings, holes, opposing_holes;
  const char* const support_name = inputs.on_maxilla() ? "maxilla" : "mandible";
  const char* const opposing_name = inputs.on_maxilla() ? "mandible" : "maxilla";
  const TriangleMesh support_dental = without_fragments(inputs.support(), support_name, warnings);
  const TriangleMesh opposing_dental = without_fragments(inputs.opposing_mi(), opposing_name, warnings);
  std::vector<std::uint8_t> fdi = jaws.of(inputs.arch).fdi;
  GNATHION_TRY(const CoveredArc covered, covered_arc(inputs.support(), fdi, arch, inputs.arch, parameters));

  const Insertion insertion =
      insertion_of(support_dental, arch, inputs.arch, covered, parameters, inputs.edits.margins);
  const Rigid3 design_from_dental = frame_along(insertion.direction, arch);
  const Rigid3 tp_from_mi = design_from_dental * inputs.opposing_motion() * design_from_dental.inverse();
  TriangleMesh support =
      transformed(design_from_dental, closed_to_solid(support_dental, insertion.direction, &holes));
  TriangleMesh opposing =
      transformed(tp_from_mi * design_from_dental,
                  closed_to_solid(opposing_dental, -insertion.direction, &opposing_holes));
  OcclusalMap level(support, arch, design_from_dental, covered);
  std::optional<MeshQuery> given_stamp;
  if (inputs.occlusal_surface) {
    GNATHION_TRY(TriangleMesh solid, stamp_solid(*inputs.occlusal_surface, design_from_dental,
                                                 crown_box(support, level, parameters.depth_mm)));
    given_stamp.emplace(std::move(solid));
  }
  std::vector<FreePose> free = free_poses(inputs, arch, design_from_dental, parameters);
  std::vector<Vector3> normals = smoothed_normals(support);
  std::vector<double> sharp = sharpness(support), sharp_opposing = sharpness(opposing);
  for (const std::string& hole : holes) warnings.push_back(fmt::format("{}: {}", support_name, hole));
  for (const std::string& hole : opposing_holes)
    warnings.push_back(fmt::format("{}: {}", opposing_name, hole));
  Preparation preparation{std::move(arch),
                          design_from_dental,
                          insertion,
                          tp_from_mi,
                          MeshQuery(std::move(support)),
                          MeshQuery(std::move(opposing)),
                          std::move(given_stamp),
                          std::move(normals),
                          std::move(sharp),
                          std::move(sharp_opposing),
                          EditField(inputs.edits, design_from_dental),
                          std::move(free),
                          std::move(level),
                          {},
                          1,
                          std::move(warnings),
                          std::move(fdi)};
  preparation.support_teeth = jaws.of(inputs.arch).partition;
  preparation.opposing_fdi = jaws.of(inputs.opposing_arch()).fdi;
  GNATHION_CHECK_OK(set_grid(inputs, parameters, grid, preparation));
  return preparation;
}

Result<Preparation> prepared_again(Preparation last, const SplintInputs& inputs,
                                   const SplintParameters& parameters, const PreparationGrid& grid) {
  const Rigid3 tp_from_mi =
      last.design_from_dental * inputs.opposing_motion() * last.design_from_dental.inverse();
  const Rigid3 moved = tp_from_mi * last.tp_from_mi.inverse();
  if (!moved.matrix().isIdentity(1e-12)) last.opposing = MeshQuery(transformed(moved, last.opposing.mesh()));
  last.tp_from_mi = tp_from_mi;
  last.edits = EditField(inputs.edits, last.design_from_dental);
  last.free_poses = free_poses(inputs, last.arch, last.design_from_dental, parameters);
  GNATHION_CHECK_OK(set_grid(inputs, parameters, grid, last));
  return last;
}

}  // namespace gnathion
