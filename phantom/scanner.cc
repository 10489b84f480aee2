#include "phantom/scanner.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>

#include "core/mesh_query.h"
#include "phantom/bodies_mesher.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;

/// A smooth random function with unit variance and Gaussian covariance: a sum of random waves (Rahimi &
/// Recht, "Random features", 2007).
class SmoothNoise {
 public:
  SmoothNoise(double correlation_length_mm, Random& random) {
    for (Wave& wave : waves_) {
      wave.vector = random.normal3() / correlation_length_mm;
      wave.phase = random.uniform(0, 2 * std::numbers::pi);
    }
  }
  double operator()(const Vector3& p) const {
    double sum = 0;
    for (const Wave& wave : waves_) sum += std::cos(wave.vector.dot(p) + wave.phase);
    return sum * std::sqrt(2.0 / static_cast<double>(waves_.size()));
  }

 private:
  struct Wave {
    Vector3 vector;
    double phase;
  };
  std::array<Wave, 96> waves_;
};

/// The surface meshed anew on a lattice of random position and orientation, vertices on the surface.
TriangleMesh retessellated(const MeshQuery& truth, double edge_mm, Random& random) {
  const Lattice lattice{{random.rotation(), truth.mesh().vertices_mm.front() + edge_mm * random.normal3()},
                        edge_mm};
  const auto signed_distance = [&](const Vector3& p) {
    const auto found = truth.signed_distance(p, 4 * edge_mm);
    if (!found || found->closest.on_boundary) return std::numeric_limits<double>::quiet_NaN();
    return found->distance_mm;
  };
  return surface_net(cells_near_mesh(truth.mesh(), lattice), lattice, signed_distance);
}

/// Brings the vertices onto the true surface (but for a few in its sharpest creases) and gives its normals
/// there.
std::vector<Vector3> settle(TriangleMesh& mesh, const MeshQuery& truth) {
  std::vector<Vector3> normals(mesh.vertices_mm.size(), Vector3::Zero()), targets = mesh.vertices_mm;
  tbb::parallel_for(std::size_t{0}, targets.size(), [&](std::size_t v) {
    const auto found = truth.closest(targets[v]);
    if (!found) return;
    targets[v] = found->point_mm;
    normals[v] = found->normal.normalized();
  });
  move_without_folds(mesh, targets);
  return normals;
}

bool is_seen(const Vector3& p, const Vector3& normal, const MeshQuery& truth, const ScannerModel& model) {
  constexpr double kOff_mm = 0.02;  // off the surface, not to meet it at the start
  const double least_cosine = std::cos(model.max_incidence_deg * kRad);
  for (const Vector3& view : model.views) {
    if (normal.dot(view) < least_cosine) continue;
    if (!truth.ray(p + kOff_mm * normal, view, 0.0, model.reach_mm)) return true;
  }
  return false;
}

/// An ellipsoid in which the scanner lost the surface.
struct Hole {
  Vector3 centre;
  Matrix3 to_unit;
  bool contains(const Vector3& p) const { return (to_unit * (p - centre)).squaredNorm() < 1.0; }
};

std::vector<Hole> draw_holes(const TriangleMesh& mesh, const ScannerModel& model, Random& random) {
  std::vector<Hole> holes;
  for (int n = 0; n < model.holes; ++n) {
    const Vector3 centre =
        mesh.vertices_mm[random.below(static_cast<std::uint32_t>(mesh.vertices_mm.size()))];
    Vector3 radii;
    for (int axis = 0; axis < 3; ++axis)
      radii[axis] = random.uniform(model.hole_radius_min_mm, model.hole_radius_max_mm);
    const Matrix3 turn = random.rotation();
    holes.push_back({centre, radii.cwiseInverse().asDiagonal() * turn});
  }
  return holes;
}

using Triangles = std::vector<Triangle>;

Triangles without_vertices(const Triangles& triangles, const std::vector<bool>& lost) {
  Triangles kept;
  std::copy_if(triangles.begin(), triangles.end(), std::back_inserter(kept),
               [&](const Triangle& t) { return !lost[t[0]] && !lost[t[1]] && !lost[t[2]]; });
  return kept;
}

/// The three undirected edges of every triangle, sorted, so that equal ones stand together.
std::vector<std::array<std::uint32_t, 2>> sorted_edges(const Triangles& triangles) {
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(3 * triangles.size());
  for (const Triangle& t : triangles)
    for (std::size_t c = 0; c < 3; ++c)
      edges.push_back({std::min(t[c], t[(c + 1) % 3]), std::max(t[c], t[(c + 1) % 3])});
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// Calls visit(edge, number of triangles on it).
template <class Visit>
void for_each_edge(const Triangles& triangles, const Visit& visit) {
  const auto edges = sorted_edges(triangles);
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t j = i + 1;
    while (j < edges.size() && edges[j] == edges[i]) ++j;
    visit(edges[i], j - i);
    i = j;
  }
}

/// Takes the rim away, `rings` times.
Triangles trimmed(Triangles triangles, std::size_t vertices, int rings) {
  for (int ring = 0; ring < rings; ++ring) {
    std::vector<bool> on_rim(vertices, false);
    for_each_edge(triangles, [&](const auto& edge, std::size_t count) {
      if (count == 1) on_rim[edge[0]] = on_rim[edge[1]] = true;
    });
    triangles = without_vertices(triangles, on_rim);
  }
  return triangles;
}

/// Opens the mesh where more than two triangles meet in an edge or two rims in a vertex.
Triangles without_pinches(Triangles triangles, std::size_t vertices) {
  for (;;) {
    std::vector<std::uint8_t> rims(vertices, 0);
    std::vector<bool> pinched(vertices, false);
    bool any = false;
    for_each_edge(triangles, [&](const auto& edge, std::size_t count) {
      for (const std::uint32_t v : edge) {
        if (count == 1 && ++rims[v] > 2) pinched[v] = any = true;
        if (count > 2) pinched[v] = any = true;
      }
    });
    if (!any) return triangles;
    triangles = without_vertices(triangles, pinched);
  }
}

/// What is left of the mesh without its lost vertices, trimmed at all rims, without islands. `normals`
/// follow.
TriangleMesh cut_back(const TriangleMesh& mesh, const std::vector<bool>& lost_vertex,
                      const ScannerModel& model, std::vector<Vector3>& normals) {
  const int rings = static_cast<int>(std::lround(model.rim_trim_mm / model.edge_mm));
  const std::size_t vertices = mesh.vertices_mm.size();
  TriangleMesh kept = mesh;
  kept.triangles = trimmed(without_vertices(mesh.triangles, lost_vertex), vertices, rings);
  kept.triangles = without_pinches(std::move(kept.triangles), vertices);
  // Normals travel as vertices of a twin mesh, so that both are renumbered alike.
  TriangleMesh twin = kept;
  twin.vertices_mm = normals;
  normals = without_islands(twin, model.smallest_component).vertices_mm;
  return without_islands(kept, model.smallest_component);
}

}  // namespace

ScannerModel intraoral_scanner(const Vector3& occlusal) {
  ScannerModel model;
  const Vector3 up = occlusal.normalized(), side = up.unitOrthogonal(), front = up.cross(side);
  model.views.push_back(up);
  for (const double elevation_deg : {50.0, 20.0, -5.0})
    for (int azimuth_deg = 0; azimuth_deg < 360; azimuth_deg += 45) {
      const double a = azimuth_deg * kRad, e = elevation_deg * kRad;
      model.views.push_back(std::sin(e) * up + std::cos(e) * (std::cos(a) * side + std::sin(a) * front));
    }
  return model;
}

ScannerModel face_scanner(const Vector3& front, const Vector3& up) {
  ScannerModel model;
  model.edge_mm = 1.0;
  model.white_noise_mm = 0.05;
  model.correlated_noise_mm = 0.03;
  model.holes = 12;
  model.hole_radius_min_mm = 1.5;
  model.hole_radius_max_mm = 5;
  model.rim_trim_mm = 1.0;
  model.reach_mm = 450;
  model.max_incidence_deg = 70;
  model.smallest_component = 150;
  const Vector3 forward = front.normalized(), side = forward.cross(up).normalized(),
                top = side.cross(forward);
  const auto view = [&](double sideways_deg, double up_deg) {
    const double a = sideways_deg * kRad, e = up_deg * kRad;
    model.views.push_back(std::cos(e) * (std::cos(a) * forward + std::sin(a) * side) + std::sin(e) * top);
  };
  for (const double sideways : {0.0, -25.0, 25.0, -50.0, 50.0}) view(sideways, 0);
  for (const double sideways : {-35.0, 0.0, 35.0}) view(sideways, 32);
  for (const double sideways : {-35.0, 0.0, 35.0}) view(sideways, -28);
  return model;
}

TriangleMesh simulate_scan(const TriangleMesh& surface, const ScannerModel& model,
                           const Rigid3& scan_from_surface, Random& random) {
  const MeshQuery truth(surface);
  TriangleMesh mesh = retessellated(truth, model.edge_mm, random);
  std::vector<Vector3> normals = settle(mesh, truth);

  const std::vector<Hole> holes = draw_holes(mesh, model, random);
  std::vector<std::uint8_t> lost(mesh.vertices_mm.size(), 0);
  tbb::parallel_for(std::size_t{0}, lost.size(), [&](std::size_t v) {
    const Vector3& p = mesh.vertices_mm[v];
    const auto in_hole = [&](const Hole& hole) { return hole.contains(p); };
    lost[v] = !is_seen(p, normals[v], truth, model) || std::any_of(holes.begin(), holes.end(), in_hole);
  });
  mesh = cut_back(mesh, std::vector<bool>(lost.begin(), lost.end()), model, normals);

  const SmoothNoise smooth(model.correlation_length_mm, random);
  std::vector<double> error_mm(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, error_mm.size(), [&](std::size_t v) {
    error_mm[v] = model.correlated_noise_mm * smooth(mesh.vertices_mm[v]);
  });
  const Vector3 centre = model.scale_centre_mm.value_or(surface_centroid_mm(surface));
  for (std::size_t v = 0; v < error_mm.size(); ++v) {
    const Vector3 p =
        mesh.vertices_mm[v] + (error_mm[v] + model.white_noise_mm * random.normal()) * normals[v];
    mesh.vertices_mm[v] = scan_from_surface * (centre + (1 + model.scale_error) * (p - centre));
  }
  return mesh;
}

}  // namespace gnathion
