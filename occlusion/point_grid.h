// Nearest neighbours among fixed points within a small radius, by hashing into cells. Exact, and the
// answer does not depend on how the cells lie.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <unordered_map>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Immutable after construction; queries are thread-safe.
class NeighbourGrid {
 public:
  NeighbourGrid(std::vector<Vector3> points_mm, double cell_mm) : points_(std::move(points_mm)), cell_(cell_mm) {
    cells_.reserve(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) cells_[key(cell_of(points_[i]))].push_back(i);
  }

  /// Index of the nearest point no farther than radius_mm; of equally near ones the first.
  std::optional<std::size_t> nearest(const Vector3& p_mm, double radius_mm) const {
    double best = radius_mm * radius_mm;
    std::optional<std::size_t> found;
    const std::int64_t reach = static_cast<std::int64_t>(std::ceil(radius_mm / cell_));
    const Index centre = cell_of(p_mm);
    for (std::int64_t ring = 0; ring <= reach; ++ring) {
      const double nearest_possible = static_cast<double>(ring - 1) * cell_;  // of any point in this ring
      if (found && nearest_possible > 0.0 && nearest_possible * nearest_possible > best) break;
      visit_ring(centre, ring, [&](std::size_t i) {
        const double d = (points_[i] - p_mm).squaredNorm();
        if (d < best || (d == best && (!found || i < *found))) {
          best = d;
          found = i;
        }
      });
    }
    return found;
  }

  const std::vector<Vector3>& points() const { return points_; }

 private:
  using Index = Eigen::Matrix<std::int64_t, 3, 1>;
  Index cell_of(const Vector3& p) const { return (p / cell_).array().floor().matrix().cast<std::int64_t>(); }
  static std::uint64_t key(const Index& c) {
    auto part = [](std::int64_t v) { return static_cast<std::uint64_t>(v + (1 << 20)) & 0x1fffff; };
    return part(c.x()) | (part(c.y()) << 21) | (part(c.z()) << 42);
  }
  template <class F>
  void visit_ring(const Index& centre, std::int64_t ring, F&& visit) const {
    for (std::int64_t x = -ring; x <= ring; ++x)
      for (std::int64_t y = -ring; y <= ring; ++y) {
        const bool shell = std::max(std::abs(x), std::abs(y)) == ring;
        for (std::int64_t z = -ring; z <= ring; z += (shell || ring == 0) ? 1 : 2 * ring) {
          const auto it = cells_.find(key(centre + Index(x, y, z)));
          if (it == cells_.end()) continue;
          for (const std::size_t i : it->second) visit(i);
        }
      }
  }

  std::vector<Vector3> points_;
  double cell_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

}  // namespace gnathion
