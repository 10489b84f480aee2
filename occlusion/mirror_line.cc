#include "occlusion/mirror_line.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "occlusion/point_grid.h"

namespace gnathion {

MirrorLine refine_mirror_line(const std::vector<Eigen::Vector2d>& points_mm, MirrorLine line,
                              double reach_mm) {
  std::vector<Vector3> flat;
  flat.reserve(points_mm.size());
  for (const auto& p : points_mm) flat.emplace_back(p.x(), p.y(), 0.0);
  const NeighbourGrid grid(flat, 1.0);
  std::vector<std::size_t> partner(points_mm.size());
  constexpr std::size_t kNone = ~std::size_t{0};

  for (int iteration = 0; iteration < 60; ++iteration) {
    const double reach = std::max(2.0, reach_mm * std::pow(0.85, iteration));
    tbb::parallel_for(std::size_t{0}, points_mm.size(), [&](std::size_t i) {
      const Eigen::Vector2d m = line.mirrored(points_mm[i]);
      partner[i] = grid.nearest({m.x(), m.y(), 0.0}, reach).value_or(kNone);
    });
    Eigen::Matrix2d h = Eigen::Matrix2d::Zero();
    Eigen::Vector2d g = Eigen::Vector2d::Zero();
    double sum = 0.0;
    std::size_t count = 0;
    const Eigen::Vector2d n = line.normal(), t(-n.y(), n.x());
    for (std::size_t i = 0; i < points_mm.size(); ++i) {
      if (partner[i] == kNone) continue;
      const Eigen::Vector2d &p = points_mm[i], &q = points_mm[partner[i]];
      const Eigen::Vector2d r = line.mirrored(p) - q;
      Eigen::Matrix2d j;  // columns: angle, offset
      j.col(0) = -2.0 * t.dot(p) * n - 2.0 * (n.dot(p) - line.offset_mm) * t;
      j.col(1) = 2.0 * n;
      h += j.transpose() * j;
      g += j.transpose() * r;
      sum += r.squaredNorm();
      ++count;
    }
    if (count < 10) break;
    line.rms_mm = std::sqrt(sum / static_cast<double>(count));
    const Eigen::Vector2d step = h.ldlt().solve(g);
    if (!step.allFinite()) break;
    line.normal_angle_rad -= step.x();
    line.offset_mm -= step.y();
    if (reach <= 2.0 && std::abs(step.x()) < 1e-7 && std::abs(step.y()) < 1e-6) break;
  }
  return line;
}

}  // namespace gnathion
