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
  TriangleMesh mesh = surface_net(cells_near_mesh(truth.mesh(), lattice), lattice, signed_distance);
  return mesh;
}

/// Brings the vertices onto the true surface and gives its normals there.
std::vector<Vector3> settle(TriangleMesh& mesh, const MeshQuery& truth) {
  std::vector<Vector3> normals(mesh.vertices_mm.size(), Vector3::Zero());
  tbb::parallel_for(std::size_t{0}, mesh.vertices_mm.size(), [&](std::size_t v) {
    const auto found = truth.closest(mesh.vertices_mm[v]);
    if (!found) return;
    mesh.vertices_mm[v] = found->point_mm;
    normals[v] = found->normal.normalized();
  });
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

/// Without the triangles that have a lost vertex, and `rings` more around each rim.
TriangleMesh cut_back(const TriangleMesh& mesh, std::vector<bool> lost_vertex, int rings,
                      std::size_t smallest, std::vector<Vector3>& normals) {
  const auto is_kept = [&](const Triangle& t) {
    return !lost_vertex[t[0]] && !lost_vertex[t[1]] && !lost_vertex[t[2]];
  };
  for (const auto& loop : boundary_loops(mesh))
    for (const std::uint32_t v : loop) lost_vertex[v] = true;
  for (int ring = 0; ring < rings; ++ring) {
    std::vector<bool> next = lost_vertex;
    for (const Triangle& t : mesh.triangles)
      if (!is_kept(t))
        for (const std::uint32_t v : t) next[v] = true;
    lost_vertex.swap(next);
  }
  // Normals travel as vertices of a twin mesh, so that both are renumbered alike.
  TriangleMesh kept = mesh, twin = mesh;
  twin.vertices_mm = normals;
  kept.triangles.clear();
  std::copy_if(mesh.triangles.begin(), mesh.triangles.end(), std::back_inserter(kept.triangles), is_kept);
  twin.triangles = kept.triangles;
  kept = without_islands(kept, smallest);
  normals = without_islands(twin, smallest).vertices_mm;
  return kept;
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
  const int rings = static_cast<int>(std::lround(model.rim_trim_mm / model.edge_mm));
  mesh =
      cut_back(mesh, std::vector<bool>(lost.begin(), lost.end()), rings, model.smallest_component, normals);

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
