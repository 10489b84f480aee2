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
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Index cell = cell_of(points_[i]);
      low_ = low_.cwiseMin(cell);
      high_ = high_.cwiseMax(cell);
      cells_[key(cell)].push_back(i);
    }
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
    // Only where there are cells at all: points in a plane, or a centre beside them, cost little.
    const Index from = (centre - Index::Constant(ring)).cwiseMax(low_);
    const Index to = (centre + Index::Constant(ring)).cwiseMin(high_);
    for (std::int64_t x = from.x(); x <= to.x(); ++x)
      for (std::int64_t y = from.y(); y <= to.y(); ++y) {
        if (std::max(std::abs(x - centre.x()), std::abs(y - centre.y())) == ring) {
          for (std::int64_t z = from.z(); z <= to.z(); ++z) visit_cell({x, y, z}, visit);
        } else {
          if (centre.z() - ring >= from.z()) visit_cell({x, y, centre.z() - ring}, visit);
          if (centre.z() + ring <= to.z()) visit_cell({x, y, centre.z() + ring}, visit);
        }
      }
  }
  template <class F>
  void visit_cell(const Index& cell, F&& visit) const {
    const auto it = cells_.find(key(cell));
    if (it == cells_.end()) return;
    for (const std::size_t i : it->second) visit(i);
  }

  std::vector<Vector3> points_;
  double cell_;
  // Of the cells that hold points.
  Index low_ = Index::Constant(std::numeric_limits<std::int64_t>::max());
  Index high_ = Index::Constant(std::numeric_limits<std::int64_t>::min());
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

}  // namespace gnathion
