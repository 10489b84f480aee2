#include "phantom/film_scene.h"

#include <cmath>
#include <map>

namespace gnathion {
namespace {

/// Vertex clustering (Rossignac & Borrel 1993): one vertex, the mean, per cell of `cell_mm`.
TriangleMesh coarsened(const TriangleMesh& mesh, double cell_mm) {
  std::map<std::array<long, 3>, std::uint32_t> cells;
  std::vector<std::uint32_t> cluster_of;
  std::vector<Vector3> sums;
  std::vector<double> counts;
  for (const Vector3& p : mesh.vertices_mm) {
    const auto index = [&](double v) { return std::lround(v / cell_mm); };
    const auto [cell, fresh] = cells.try_emplace({index(p.x()), index(p.y()), index(p.z())},
                                                 static_cast<std::uint32_t>(sums.size()));
    if (fresh) {
      sums.push_back(Vector3::Zero());
      counts.push_back(0);
    }
    sums[cell->second] += p;
    counts[cell->second] += 1;
    cluster_of.push_back(cell->second);
  }
  TriangleMesh coarse;
  for (std::size_t i = 0; i < sums.size(); ++i) coarse.vertices_mm.push_back(sums[i] / counts[i]);
  for (const Triangle& t : mesh.triangles) {
    const Triangle c{cluster_of[t[0]], cluster_of[t[1]], cluster_of[t[2]]};
    if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) coarse.triangles.push_back(c);
  }
  return coarse;
}

constexpr double kBodyCellMm = 1.0;

TriangleMesh painted(TriangleMesh mesh, std::uint8_t grey) {
  mesh.colors_rgb.assign(mesh.vertices_mm.size(), {grey, grey, grey});
  return mesh;
}

/// Teeth light, gingiva and skin darker.
TriangleMesh visible_jaw(const TriangleMesh& jaw, const std::vector<std::uint8_t>& fdi) {
  // Crowns and gums apart, so that clustering does not mix their colours.
  std::vector<bool> is_crown, is_gum;
  for (const Triangle& t : jaw.triangles) {
    is_crown.push_back(fdi[t[0]] != 0);
    is_gum.push_back(!is_crown.back());
  }
  constexpr double kCellMm = 1.2;
  return merged(painted(coarsened(submesh(jaw, is_crown), kCellMm), 205),
                painted(coarsened(submesh(jaw, is_gum), kCellMm), 120));
}

/// Outward ellipsoid with half axes `radii_mm`.
TriangleMesh ellipsoid(const Vector3& centre_mm, const Vector3& radii_mm) {
  constexpr std::uint32_t kRings = 48, kSides = 72;
  TriangleMesh mesh;
  for (std::uint32_t r = 0; r <= kRings; ++r)
    for (std::uint32_t s = 0; s < kSides; ++s) {
      const double polar = M_PI * r / kRings, around = 2 * M_PI * s / kSides;
      const Vector3 unit(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                         std::cos(polar));
      mesh.vertices_mm.push_back(centre_mm + radii_mm.cwiseProduct(unit));
    }
  for (std::uint32_t r = 0; r < kRings; ++r)
    for (std::uint32_t s = 0; s < kSides; ++s) {
      const std::uint32_t a = r * kSides + s, b = r * kSides + (s + 1) % kSides;
      mesh.triangles.push_back({a, a + kSides, b + kSides});
      mesh.triangles.push_back({a, b + kSides, b});
    }
  return mesh;
}

/// What stands behind the open mouth in a picture: throat, neck and shoulders, far behind the teeth.
TriangleMesh throat_and_shoulders() {
  return merged(painted(ellipsoid({0, 152, -70}, {60, 62, 210}), 85),
                painted(ellipsoid({0, 160, -250}, {215, 105, 130}), 110));
}

}  // namespace

FilmScene film_scene(const PhantomPatient& patient) {
  const PhantomJaws& jaws = patient.jaws;
  FilmScene scene;
  scene.rig = phantom_rig(patient);
  scene.bow_from_dental = patient.bow_from_dental;
  scene.head_from_dental = patient.head_from_dental;
  scene.camera_from_dental_at_rest = phantom_camera_from_dental_at_rest();
  scene.therapeutic = patient.therapeutic;
  scene.condyle_left_mm = jaws.landmarks.condyle_left_mm;
  scene.condyle_right_mm = jaws.landmarks.condyle_right_mm;
  scene.incisal_point_mm = jaws.landmarks.lower_incisal_point_mm;
  scene.bow_surface =
      merged(painted(coarsened(patient.bow.surface, kBodyCellMm), 90),
             transformed(patient.bow_from_dental.rigid, visible_jaw(jaws.mandible_mi, jaws.mandible_fdi)));
  const TriangleMesh head =
      merged(painted(coarsened(patient.face, 1.3), 165),
             merged(visible_jaw(jaws.maxilla, jaws.maxilla_fdi), throat_and_shoulders()));
  scene.head_surface = merged(painted(coarsened(patient.head_frame.surface, kBodyCellMm), 90),
                              transformed(patient.head_from_dental.rigid, head));
  return scene;
}

}  // namespace gnathion
