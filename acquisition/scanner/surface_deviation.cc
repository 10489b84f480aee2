#include "acquisition/scanner/surface_deviation.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "registration/point_grid.h"

namespace gnathion {
namespace {

constexpr std::size_t kCentres = 3000;
constexpr std::size_t kLeastNeighbours = 14, kMostNeighbours = 200;

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_edge_mm(const TriangleMesh& mesh) {
  std::vector<double> lengths;
  const std::size_t step = std::max<std::size_t>(1, mesh.triangles.size() / 20000);
  for (std::size_t t = 0; t < mesh.triangles.size(); t += step)
    for (int k = 0; k < 3; ++k) lengths.push_back((mesh.corner(t, k) - mesh.corner(t, (k + 1) % 3)).norm());
  return median(lengths);
}

/// Variance about the best quadric over the neighbours; nothing where they do not carry one.
std::optional<double> variance_of_patch(const std::vector<Vector3>& points, const Vector3& centre,
                                        const Vector3& normal, double radius) {
  const Vector3 u = normal.unitOrthogonal(), v = normal.cross(u);
  const auto n = static_cast<long>(points.size());
  Eigen::MatrixXd a(n, 6);
  Eigen::VectorXd height(n);
  for (long i = 0; i < n; ++i) {
    const Vector3 d = points[static_cast<std::size_t>(i)] - centre;
    const double x = d.dot(u) / radius, y = d.dot(v) / radius;
    a.row(i) << 1, x, y, x * x, x * y, y * y;
    height[i] = d.dot(normal);
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(a);
  if (qr.rank() < 6) return std::nullopt;
  const double freedom = static_cast<double>(n - 6);
  const double variance = (height - a * qr.solve(height)).squaredNorm() / freedom;
  // The median of a χ² lies below its mean (Wilson & Hilferty 1931).
  const double h = 1 - 2 / (9 * freedom);
  return variance / (h * h * h);
}

}  // namespace

Result<SurfaceDeviation> measure_surface_deviation(const TriangleMesh& mesh) {
  const auto too_few = [&](std::size_t n) {
    return bad_input("cannot measure deviation", "scan",
                     fmt::format("only {} neighbourhoods with enough vertices in {} vertices", n,
                                 mesh.vertices_mm.size()));
  };
  if (mesh.triangles.size() < 50) return too_few(0);
  SurfaceDeviation result;
  result.radius_mm = 3.2 * median_edge_mm(mesh);
  if (!(result.radius_mm > 0)) return too_few(0);
  const PointGrid grid(mesh.vertices_mm, result.radius_mm);
  const std::vector<Vector3> normals = vertex_normals(mesh);
  const std::size_t step = std::max<std::size_t>(1, mesh.vertices_mm.size() / kCentres);
  std::vector<double> variances;
  std::vector<Vector3> neighbours;
  for (std::size_t c = 0; c < mesh.vertices_mm.size(); c += step) {
    // Single normals of a coarse scan are wild; their mean is not.
    Vector3 facing = Vector3::Zero();
    grid.for_each_within(mesh.vertices_mm[c], result.radius_mm,
                         [&](std::uint32_t i, double) { facing += normals[i]; });
    if (facing.norm() < 1e-6) continue;
    facing.normalize();
    neighbours.clear();
    grid.for_each_within(mesh.vertices_mm[c], result.radius_mm, [&](std::uint32_t i, double) {
      // The other side of something thin is not a neighbour.
      if (normals[i].dot(facing) > 0) neighbours.push_back(mesh.vertices_mm[i]);
    });
    if (neighbours.size() < kLeastNeighbours || neighbours.size() > kMostNeighbours) continue;
    const auto variance = variance_of_patch(neighbours, mesh.vertices_mm[c], facing, result.radius_mm);
    if (variance) variances.push_back(*variance);
  }
  result.patches = variances.size();
  if (variances.size() < 30) return too_few(variances.size());
  result.sigma_mm = std::sqrt(median(variances));
  return result;
}

}  // namespace gnathion
