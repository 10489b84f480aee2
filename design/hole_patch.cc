#include "design/hole_patch.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/Cholesky>

namespace gnathion {
namespace {

constexpr double kWidestMm = 5.0;     // beyond it nothing is known of the surface
constexpr double kSafePart = 0.1;     // of the width
constexpr double kSteepestCos = 0.2;  // of the surface about the hole to the hole's own plane
constexpr double kMostBulge = 0.5;    // of the width
constexpr int kLeastAbout = 12;

using Coefficients = Eigen::Matrix<double, 6, 1>;

Coefficients powers(double x, double y) {
  Coefficients out;
  out << 1.0, x, y, x * x, x * y, y * y;
  return out;
}

/// The hole's plane: origin in its middle, third axis out of the solid.
struct Plane {
  Vector3 origin;
  Matrix3 axes;
  double radius = 0.0;  // mean
  Vector3 local(const Vector3& p) const { return axes.transpose() * (p - origin); }
};

Plane plane_of(const std::vector<Vector3>& vertices, const std::vector<std::uint32_t>& loop) {
  Plane plane;
  plane.origin.setZero();
  for (const std::uint32_t v : loop) plane.origin += vertices[v];
  plane.origin /= static_cast<double>(loop.size());
  Vector3 normal = Vector3::Zero();
  for (std::size_t i = 0; i < loop.size(); ++i)
    normal += (vertices[loop[i]] - plane.origin).cross(vertices[loop[(i + 1) % loop.size()]] - plane.origin);
  plane.axes.col(2) = normal.normalized();
  plane.axes.col(0) = plane.axes.col(2).unitOrthogonal();
  plane.axes.col(1) = plane.axes.col(2).cross(plane.axes.col(0));
  for (const std::uint32_t v : loop)
    plane.radius += plane.local(vertices[v]).head<2>().norm() / static_cast<double>(loop.size());
  return plane;
}

/// Seen from the middle the rim goes round once, without turning back.
bool star_shaped(const std::vector<Vector3>& rim) {
  for (std::size_t i = 0; i < rim.size(); ++i) {
    const Vector3 &a = rim[i], &b = rim[(i + 1) % rim.size()];
    if (a.x() * b.y() - a.y() * b.x() <= 0.0) return false;
  }
  return true;
}

/// Height over the plane of the surface about the hole, nearer vertices counting more.
std::optional<Coefficients> fitted(const TriangleMesh& mesh, const std::vector<Vector3>& normals,
                                   const Plane& plane) {
  const double reach = plane.radius + std::max(0.7, 0.8 * plane.radius);
  Eigen::Matrix<double, 6, 6> left = Eigen::Matrix<double, 6, 6>::Zero();
  Coefficients right = Coefficients::Zero();
  int about = 0;
  for (std::size_t v = 0; v < normals.size(); ++v) {
    if ((mesh.vertices_mm[v] - plane.origin).squaredNorm() > 2.0 * reach * reach) continue;
    if (normals[v].dot(plane.axes.col(2)) < kSteepestCos) continue;
    const Vector3 q = plane.local(mesh.vertices_mm[v]);
    const double beyond = q.head<2>().norm();
    if (beyond > reach) continue;
    const double weight =
        std::exp(-std::pow(std::max(0.0, beyond - plane.radius) / (0.5 * plane.radius + 0.2), 2));
    const Coefficients row = powers(q.x() / reach, q.y() / reach);
    left += weight * row * row.transpose();
    right += weight * q.z() * row;
    ++about;
  }
  if (about < kLeastAbout) return std::nullopt;
  left.diagonal().array() += 1e-9 * left.trace();
  Coefficients c = left.ldlt().solve(right);
  if (!c.allFinite()) return std::nullopt;
  c.segment<2>(1) /= reach;
  c.tail<3>() /= reach * reach;
  return c;
}

/// Lowest of the rim's tangent planes.
double under_tangents(const std::vector<Vector3>& rim, const std::vector<Vector3>& rim_normals, double x,
                      double y) {
  double lowest = 1e300;
  for (std::size_t i = 0; i < rim.size(); ++i) {
    const Vector3& n = rim_normals[i];
    if (n.z() < kSteepestCos) continue;
    lowest = std::min(lowest, rim[i].z() - (n.x() * (x - rim[i].x()) + n.y() * (y - rim[i].y())) / n.z());
  }
  return lowest;
}

}  // namespace

bool fill_with_patch(TriangleMesh& mesh, const std::vector<Vector3>& normals,
                     const std::vector<std::uint32_t>& loop) {
  if (loop.size() < 5) return false;
  const Plane plane = plane_of(mesh.vertices_mm, loop);
  const double width = 2.0 * plane.radius;
  if (!plane.axes.allFinite() || width > kWidestMm) return false;
  std::vector<Vector3> rim, rim_normals;
  for (const std::uint32_t v : loop) {
    rim.push_back(plane.local(mesh.vertices_mm[v]));
    rim_normals.push_back(plane.axes.transpose() * normals[v]);
    if (std::abs(rim.back().z()) > kMostBulge * width) return false;
  }
  if (!star_shaped(rim)) return false;
  const auto surface = fitted(mesh, normals, plane);
  if (!surface) return false;

  const std::size_t n = loop.size();
  const int rings = std::clamp(static_cast<int>(std::lround(static_cast<double>(n) / 6.0)), 2, 6);
  const auto height = [&](double x, double y, double chord, double rest) {
    double z = surface->dot(powers(x, y)) + rest;
    if (width > kUnsureHoleMm)
      z = std::max({z, chord, std::min(z + kSafePart * width, under_tangents(rim, rim_normals, x, y))});
    return z;
  };
  // What the rim is off the quadric fades towards the middle.
  std::vector<double> rest(n);
  for (std::size_t i = 0; i < n; ++i) rest[i] = rim[i].z() - surface->dot(powers(rim[i].x(), rim[i].y()));
  std::vector<Vector3> added;
  for (int ring = 1; ring < rings; ++ring) {
    const double s = 1.0 - static_cast<double>(ring) / rings;
    for (std::size_t i = 0; i < n; ++i) {
      const double x = s * rim[i].x(), y = s * rim[i].y();
      added.emplace_back(x, y, height(x, y, s * rim[i].z(), s * rest[i]));
    }
  }
  added.emplace_back(0.0, 0.0, height(0.0, 0.0, 0.0, 0.0));
  for (const Vector3& q : added)
    if (!(std::abs(q.z()) <= kMostBulge * width)) return false;

  const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  for (const Vector3& q : added) mesh.vertices_mm.push_back(plane.origin + plane.axes * q);
  const auto at = [&](int ring, std::size_t i) {
    return ring == 0 ? loop[i % n]
                     : first + static_cast<std::uint32_t>((static_cast<std::size_t>(ring) - 1) * n + i % n);
  };
  for (int ring = 0; ring + 1 < rings; ++ring)
    for (std::size_t i = 0; i < n; ++i) {
      mesh.triangles.push_back({at(ring, i), at(ring, i + 1), at(ring + 1, i)});
      mesh.triangles.push_back({at(ring, i + 1), at(ring + 1, i + 1), at(ring + 1, i)});
    }
  const auto hub = first + static_cast<std::uint32_t>(added.size() - 1);
  for (std::size_t i = 0; i < n; ++i) mesh.triangles.push_back({at(rings - 1, i), at(rings - 1, i + 1), hub});
  return true;
}

}  // namespace gnathion
