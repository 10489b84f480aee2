// For tests: surfaces as a second scan of the same body would give them. Independent of the phantom's
// scanner.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <tuple>
#include <vector>

#include "core/mesh.h"
#include "core/random.h"

namespace gnathion::testing_surfaces {

inline std::filesystem::path shared_data() {
  const char* root = std::getenv("GNATHION_SHARED");
  return std::filesystem::path(root ? root : "../shared") / "data";
}

/// Each triangle becomes four, through the midpoints of its edges.
inline TriangleMesh subdivided(const TriangleMesh& mesh) {
  TriangleMesh out;
  out.vertices_mm = mesh.vertices_mm;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
  const auto mid = [&](std::uint32_t a, std::uint32_t b) {
    const auto [it, fresh] = middle.try_emplace({std::min(a, b), std::max(a, b)},
                                                static_cast<std::uint32_t>(out.vertices_mm.size()));
    if (fresh) out.vertices_mm.push_back(0.5 * (mesh.vertices_mm[a] + mesh.vertices_mm[b]));
    return it->second;
  };
  for (const Triangle& t : mesh.triangles) {
    const std::uint32_t ab = mid(t[0], t[1]), bc = mid(t[1], t[2]), ca = mid(t[2], t[0]);
    for (const Triangle& s : {Triangle{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}}) {
      out.triangles.push_back(s);
    }
  }
  return out;
}

/// Another tessellation: vertices are random points of the surface, one for each occupied cell of a turned
/// grid, and come in another order.
inline TriangleMesh retessellated(const TriangleMesh& mesh, double cell_mm, Random& random) {
  TriangleMesh fine = mesh;
  for (int level = 0; level < 3; ++level) {
    double mean_area = surface_area_mm2(fine) / static_cast<double>(fine.triangles.size());
    if (std::sqrt(mean_area) < 0.45 * cell_mm) break;
    fine = subdivided(fine);
  }
  const Matrix3 turn = random.rotation();
  std::map<std::tuple<long, long, long>, std::vector<std::uint32_t>> cells;
  std::vector<std::tuple<long, long, long>> cell_of(fine.vertices_mm.size());
  for (std::uint32_t i = 0; i < fine.vertices_mm.size(); ++i) {
    const Vector3 p = (turn * fine.vertices_mm[i] / cell_mm).array().floor();
    cell_of[i] = {std::lround(p.x()), std::lround(p.y()), std::lround(p.z())};
    cells[cell_of[i]].push_back(i);
  }
  TriangleMesh out;
  std::map<std::tuple<long, long, long>, std::uint32_t> index;
  for (const auto& [cell, members] : cells) {
    index[cell] = static_cast<std::uint32_t>(out.vertices_mm.size());
    out.vertices_mm.push_back(
        fine.vertices_mm[members[random.below(static_cast<std::uint32_t>(members.size()))]]);
  }
  for (const Triangle& t : fine.triangles) {
    const Triangle s{index[cell_of[t[0]]], index[cell_of[t[1]]], index[cell_of[t[2]]]};
    if (s[0] != s[1] && s[1] != s[2] && s[2] != s[0]) out.triangles.push_back(s);
  }
  for (std::size_t i = out.triangles.size(); i > 1; --i) {
    std::swap(out.triangles[i - 1], out.triangles[random.below(static_cast<std::uint32_t>(i))]);
  }
  return out;
}

/// Moves vertices along their normals: white noise and a smooth field with correlation exp(−d²/2ℓ²).
inline TriangleMesh noisy(TriangleMesh mesh, double white_mm, double correlated_mm, double length_mm,
                          Random& random) {
  constexpr int kWaves = 300;  // random Fourier features (Rahimi & Recht 2007)
  std::vector<Vector3> waves;
  std::vector<double> phases;
  for (int i = 0; i < kWaves; ++i) {
    waves.push_back(random.normal3() / length_mm);
    phases.push_back(random.uniform(0.0, 6.283185307179586));
  }
  const std::vector<Vector3> normals = vertex_normals(mesh);
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    double field = 0.0;
    if (correlated_mm > 0.0) {
      for (int k = 0; k < kWaves; ++k) field += std::cos(waves[k].dot(mesh.vertices_mm[i]) + phases[k]);
    }
    mesh.vertices_mm[i] +=
        (white_mm * random.normal() + correlated_mm * std::sqrt(2.0 / kWaves) * field) * normals[i];
  }
  return mesh;
}

/// Without the triangles whose centroid fulfils the predicate.
template <class Drop>
TriangleMesh without(const TriangleMesh& mesh, Drop&& drop) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    keep[t] = !drop((mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0);
  }
  return submesh(mesh, keep);
}

inline TriangleMesh with_holes(const TriangleMesh& mesh, int count, double radius_mm, Random& random) {
  std::vector<Vector3> centres;
  for (int i = 0; i < count; ++i) {
    centres.push_back(mesh.vertices_mm[random.below(static_cast<std::uint32_t>(mesh.vertices_mm.size()))]);
  }
  return without(mesh, [&](const Vector3& p) {
    for (const Vector3& c : centres) {
      if ((p - c).norm() < radius_mm) return true;
    }
    return false;
  });
}

/// Keeps about `fraction` of the surface: what lies on one side of a plane of random orientation.
inline TriangleMesh part_of(const TriangleMesh& mesh, double fraction, const Vector3& direction) {
  std::vector<std::pair<double, double>> heights;  // (height, area)
  double total = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const double area = face_normal_scaled(mesh, t).norm();
    heights.push_back({mesh.corner(t, 0).dot(direction), area});
    total += area;
  }
  std::sort(heights.begin(), heights.end());
  double passed = 0.0, cut = heights.back().first;
  for (const auto& [height, area] : heights) {
    passed += area;
    if (passed > fraction * total) {
      cut = height;
      break;
    }
  }
  return without(mesh, [&](const Vector3& p) { return p.dot(direction) > cut; });
}

/// Any orientation, up to `shift_mm` in each direction.
inline Rigid3 random_pose(Random& random, double shift_mm) {
  return {random.rotation(),
          shift_mm * Vector3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))};
}

/// Largest and RMS distance between two poses over a mesh's vertices.
struct PoseError {
  double rms_mm = 0.0, max_mm = 0.0, angle_deg = 0.0;
};
inline PoseError pose_error(const Rigid3& a, const Rigid3& b, const TriangleMesh& at) {
  PoseError e;
  double sum = 0.0;
  for (const Vector3& p : at.vertices_mm) {
    const double d = (a * p - b * p).norm();
    sum += d * d;
    e.max_mm = std::max(e.max_mm, d);
  }
  e.rms_mm = std::sqrt(sum / static_cast<double>(at.vertices_mm.size()));
  e.angle_deg = (a * b.inverse()).angle_rad() * 57.29577951308232;
  return e;
}

}  // namespace gnathion::testing_surfaces
