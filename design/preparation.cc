#include "design/preparation.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "design/parallel.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kCoarseMm = 0.3;
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

/// Arc lengths of the ends of the last teeth, right and left.
std::array<double, 2> ends_of_teeth(const TriangleMesh& maxilla, const ArchFrame& arch) {
  const std::vector<std::uint8_t> fdi = assign_teeth(maxilla, arch, Arch::kMaxilla);
  const ArchRuler ruler(arch);
  std::vector<double> s;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] != 0) s.push_back(ruler.measure(maxilla.vertices_mm[v]).s_mm);
  if (s.size() < 100) return {-1e3, 1e3};
  std::sort(s.begin(), s.end());
  const std::size_t few = s.size() / 500;  // stray labels
  return {s[few], s[s.size() - 1 - few]};
}

/// Crown vertices: near the arch curve and no deeper than `depth_mm` behind the local level.
Box crown_box(const TriangleMesh& maxilla, const OcclusalMap& level, double depth_mm) {
  Box box;
  for (const Vector3& v : maxilla.vertices_mm)
    if (std::abs(level.off_curve_mm(v)) < kBandHalfWidthMm && v.z() < level.level_mm(v) + depth_mm)
      box.extend(v);
  return box;
}

/// Room for the crowns, their image in TP, the shell and its fillets.
GridShape design_box(const TriangleMesh& maxilla, const OcclusalMap& level, const Rigid3& therapeutic,
                     const SplintParameters& p, double spacing_mm) {
  const Box crowns = crown_box(maxilla, level, p.depth_mm);
  Box box = crowns;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3 v(corner & 1 ? crowns.max_mm.x() : crowns.min_mm.x(),
                    corner & 2 ? crowns.max_mm.y() : crowns.min_mm.y(),
                    corner & 4 ? crowns.min_mm.z() + p.stamp_height_mm + 2.0 : crowns.min_mm.z());
    box.extend(therapeutic * v);
  }
  const double margin = p.wall_mm + p.gap_mm + p.smoothing_mm + 4 * spacing_mm;
  box.min_mm -= Vector3::Constant(margin);
  box.max_mm += Vector3(margin, margin, 0.0);
  box.max_mm.z() = std::max(box.max_mm.z(), crowns.max_mm.z()) + 4 * spacing_mm;
  GridShape shape;
  shape.spacing_mm = spacing_mm;
  // Whole multiples of the spacing, so that grids of one patient lie alike whatever T_th is.
  for (int d = 0; d < 3; ++d) {
    const double low = std::floor(box.min_mm[d] / spacing_mm);
    const double high = std::ceil(box.max_mm[d] / spacing_mm);
    shape.origin_mm[d] = low * spacing_mm;
    shape.nodes[d] = static_cast<int>(high - low) + 1;
  }
  return shape;
}

}  // namespace

Result<Preparation> prepare(const SplintInputs& inputs, const SplintParameters& parameters) {
  GNATHION_TRY(ArchFrame arch, find_arch(inputs.maxilla, inputs.mandible_mi));
  const Rigid3 design_from_dental = arch.arch_from_dental;
  const Rigid3 therapeutic = design_from_dental * inputs.therapeutic.rigid * design_from_dental.inverse();
  std::vector<std::string> warnings, holes;
  const TriangleMesh upper = without_fragments(inputs.maxilla, "maxilla", warnings);
  const TriangleMesh lower = without_fragments(inputs.mandible_mi, "mandible", warnings);
  TriangleMesh maxilla = closed_to_solid(transformed(design_from_dental, upper), Vector3::UnitZ(), &holes);
  TriangleMesh mandible = transformed(
      therapeutic, closed_to_solid(transformed(design_from_dental, lower), -Vector3::UnitZ(), nullptr));
  OcclusalMap level(maxilla, arch, design_from_dental, ends_of_teeth(inputs.maxilla, arch));
  const int refinement = std::max(1, static_cast<int>(std::lround(kCoarseMm / parameters.voxel_mm)));
  const GridShape coarse =
      design_box(maxilla, level, therapeutic, parameters, parameters.voxel_mm * refinement);
  if ((coarse.nodes.array() < 8).any() || (coarse.nodes.array() > 2000).any())
    return bad_input("cannot design", "maxilla", "no crowns found near the arch curve");
  std::vector<Vector3> normals = smoothed_normals(maxilla);
  std::vector<double> sharp = sharpness(maxilla), sharp_below = sharpness(mandible);
  for (const std::string& hole : holes) warnings.push_back("maxilla: " + hole);
  return Preparation{std::move(arch),
                     design_from_dental,
                     therapeutic,
                     MeshQuery(std::move(maxilla)),
                     MeshQuery(std::move(mandible)),
                     std::move(normals),
                     std::move(sharp),
                     std::move(sharp_below),
                     std::move(level),
                     coarse,
                     refinement,
                     std::move(warnings)};
}

}  // namespace gnathion
