// Neighbours of points, by cells.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Buckets of points in cubic cells over their bounding box. Immutable; thread-safe. The points must outlive
/// it.
class PointGrid {
 public:
  PointGrid(const std::vector<Vector3>& points_mm, double cell_mm);

  /// Calls f(index, squared distance) for every point within `radius_mm`, in a fixed order.
  template <class F>
  void for_each_within(const Vector3& p_mm, double radius_mm, F&& f) const {
    const double r2 = radius_mm * radius_mm;
    int lo[3], hi[3];
    for (int k = 0; k < 3; ++k) {
      const double low = std::floor((p_mm[k] - radius_mm - origin_[k]) / cell_);
      const double high = std::floor((p_mm[k] + radius_mm - origin_[k]) / cell_);
      if (!(high >= 0) || !(low < size_[k])) return;
      lo[k] = low < 0 ? 0 : static_cast<int>(low);
      hi[k] = high >= size_[k] ? size_[k] - 1 : static_cast<int>(high);
    }
    for (int z = lo[2]; z <= hi[2]; ++z) {
      for (int y = lo[1]; y <= hi[1]; ++y) {
        const std::size_t row = (static_cast<std::size_t>(z) * size_[1] + y) * size_[0];
        const std::uint32_t begin = start_[row + lo[0]], end = start_[row + hi[0] + 1];
        for (std::uint32_t k = begin; k < end; ++k) {
          const double d2 = (points_[order_[k]] - p_mm).squaredNorm();
          if (d2 <= r2) f(order_[k], d2);
        }
      }
    }
  }
  /// Index of the nearest point within the radius, or −1.
  long nearest(const Vector3& p_mm, double radius_mm) const {
    long best = -1;
    double best_d2 = 0.0;
    for_each_within(p_mm, radius_mm, [&](std::uint32_t i, double d2) {
      if (best < 0 || d2 < best_d2) best = static_cast<long>(i), best_d2 = d2;
    });
    return best;
  }

 private:
  const std::vector<Vector3>& points_;
  Vector3 origin_;
  double cell_;
  int size_[3];
  std::vector<std::uint32_t> start_, order_;
};

}  // namespace gnathion
