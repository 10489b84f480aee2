#include "registration/point_grid.h"

#include <algorithm>

#include "core/check.h"
#include "core/mesh.h"

namespace gnathion {

PointGrid::PointGrid(const std::vector<Vector3>& points_mm, double cell_mm)
    : points_(points_mm), origin_(Vector3::Zero()), cell_(cell_mm), size_{1, 1, 1} {
  GNATHION_CHECK(cell_mm > 0.0);
  Box box;
  for (const Vector3& p : points_) box.extend(p);
  if (!points_.empty()) {
    origin_ = box.min_mm;
    // The table stays small even when a stray point stretches the box.
    const Vector3 extent = box.size_mm();
    while ((extent.array() / cell_ + 1.0).prod() > 2e7) cell_ *= 1.5;
    for (int k = 0; k < 3; ++k) size_[k] = static_cast<int>(extent[k] / cell_) + 1;
  }
  const auto cell_of = [&](const Vector3& p) {
    std::size_t index[3];
    for (int k = 0; k < 3; ++k) {
      const int i = static_cast<int>((p[k] - origin_[k]) / cell_);
      index[k] = static_cast<std::size_t>(std::clamp(i, 0, size_[k] - 1));
    }
    return (index[2] * size_[1] + index[1]) * size_[0] + index[0];
  };
  start_.assign(static_cast<std::size_t>(size_[0]) * size_[1] * size_[2] + 1, 0);
  for (const Vector3& p : points_) ++start_[cell_of(p) + 1];
  for (std::size_t i = 1; i < start_.size(); ++i) start_[i] += start_[i - 1];
  order_.resize(points_.size());
  std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
  for (std::uint32_t i = 0; i < points_.size(); ++i) order_[next[cell_of(points_[i])]++] = i;
}

}  // namespace gnathion
