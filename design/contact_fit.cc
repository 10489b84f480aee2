#include "design/contact_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "design/crossings.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kMaybeContactMm = 0.3;  // by coarse distances, whose error is part of it
// A triangle on a paraboloid is off by 1 at its centroid and by 3/4 in the mean.
constexpr double kMeanOfCentroid = 0.75;
constexpr double kLargestVoxels = 0.1;  // more is an edge, no curvature
constexpr std::size_t kTogether = 64;

/// Triangles that the opposing arch may touch, those of one coarse cell side by side.
std::vector<std::uint32_t> touchable(const TriangleMesh& splint, const SplintField& field) {
  const GridShape& shape = field.preparation().coarse;
  std::vector<char> near(splint.vertices_mm.size());
  parallel_each(near.size(), [&](std::size_t v) {
    near[v] = field.jaws().opposing.linear(splint.vertices_mm[v]) < kMaybeContactMm;
  });
  std::vector<std::pair<std::size_t, std::uint32_t>> by_cell;
  for (std::uint32_t t = 0; t < splint.triangles.size(); ++t) {
    const auto& [a, b, c] = splint.triangles[t];
    if (!near[a] || !near[b] || !near[c]) continue;
    const Eigen::Vector3i at = located(shape, splint.vertices_mm[a]).index;
    by_cell.emplace_back(shape.index(at.x(), at.y(), at.z()), t);
  }
  std::sort(by_cell.begin(), by_cell.end());
  std::vector<std::uint32_t> out;
  for (const auto& [cell, t] : by_cell) out.push_back(t);
  return out;
}

/// The field's values at the triangles' centroids.
std::vector<double> values_at_centroids(const TriangleMesh& splint, const SplintField& field,
                                        const std::vector<std::uint32_t>& triangles) {
  std::vector<double> out(triangles.size());
  parallel_each((triangles.size() + kTogether - 1) / kTogether, [&](std::size_t group) {
    const std::size_t first = group * kTogether, last = std::min(triangles.size(), first + kTogether);
    std::vector<Vector3> points;
    for (std::size_t i = first; i < last; ++i)
      points.push_back(
          (splint.corner(triangles[i], 0) + splint.corner(triangles[i], 1) + splint.corner(triangles[i], 2)) /
          3.0);
    std::vector<double> values(points.size());
    field.exact(points, values);
    std::copy(values.begin(), values.end(), out.begin() + static_cast<std::ptrdiff_t>(first));
  });
  return out;
}

}  // namespace

void fit_contacts(TriangleMesh& splint, const SplintField& field) {
  const std::vector<std::uint32_t> triangles = touchable(splint, field);
  const std::vector<double> values = values_at_centroids(splint, field, triangles);
  const double largest_mm = kLargestVoxels * field.parameters().voxel_mm;
  struct Fan {
    Vector3 normal = Vector3::Zero();
    double value_area = 0.0, area = 0.0;
  };
  std::vector<Fan> fans(splint.vertices_mm.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t t = triangles[i];
    const Vector3 twice_area =
        (splint.corner(t, 1) - splint.corner(t, 0)).cross(splint.corner(t, 2) - splint.corner(t, 0));
    if (std::abs(values[i]) > largest_mm) continue;
    for (const std::uint32_t v : splint.triangles[t]) {
      fans[v].normal += twice_area;
      fans[v].value_area += values[i] * twice_area.norm();
      fans[v].area += twice_area.norm();
    }
  }
  const std::vector<Vector3> sound = splint.vertices_mm;
  for (std::size_t v = 0; v < fans.size(); ++v)
    if (fans[v].area > 0.0)
      splint.vertices_mm[v] -=
          kMeanOfCentroid * fans[v].value_area / fans[v].area * fans[v].normal.normalized();
  take_back_crossings(splint, sound);
}

}  // namespace gnathion
