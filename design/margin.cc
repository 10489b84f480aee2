#include "design/margin.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "design/parallel.h"
#include "design/preparation.h"

namespace gnathion {
namespace {

constexpr double kOnArchMm = 3.0;
constexpr double kLeastDepthMm = 1.0, kMostDepthMm = 12.0;
constexpr double kStepMm = 0.25;        // between the points that stand for a curve
constexpr double kMarginReachMm = 6.5;  // half of a molar: a curve on one side rules the whole tooth
constexpr double kFadeMm = 2.5;

std::vector<Vector3> resampled(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental) {
  std::vector<Vector3> out;
  for (const MarginCurve& margin : margins)
    for (std::size_t i = 0; i + 1 < margin.points_mm.size(); ++i) {
      const Vector3 a = design_from_dental * margin.points_mm[i],
                    b = design_from_dental * margin.points_mm[i + 1];
      const int n = std::max(1, static_cast<int>(std::ceil((b - a).norm() / kStepMm)));
      for (int k = 0; k <= n; ++k) out.push_back(a + (b - a) * (static_cast<double>(k) / n));
    }
  return out;
}

}  // namespace

Status check_margins(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                     const MeshQuery& support, const OcclusalMap& level) {
  for (std::size_t m = 0; m < margins.size(); ++m)
    for (std::size_t i = 0; i < margins[m].points_mm.size(); ++i) {
      const Vector3 p = design_from_dental * margins[m].points_mm[i];
      const auto refuse = [&](const std::string& why) {
        return bad_input("cannot design", fmt::format("margin {}, point {}", m + 1, i + 1), why);
      };
      if (!support.closest(p, kOnArchMm))
        return refuse(fmt::format("it is more than {} mm from the arch that wears the splint", kOnArchMm));
      const double depth = p.z() - level.level_mm(p);
      if (depth < kLeastDepthMm || depth > kMostDepthMm)
        return refuse(fmt::format("it lies {:.1f} mm behind the occlusal level: {} to {} can be trimmed at",
                                  depth, kLeastDepthMm, kMostDepthMm));
    }
  return {};
}

double deepest_margin_mm(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                         const OcclusalMap& level) {
  double deepest = 0.0;
  for (const MarginCurve& margin : margins)
    for (const Vector3& dental : margin.points_mm) {
      const Vector3 p = design_from_dental * dental;
      deepest = std::max(deepest, p.z() - level.level_mm(p));
    }
  return deepest;
}

MarginSurface::MarginSurface(const std::vector<MarginCurve>& margins, const Rigid3& design_from_dental,
                             const GridShape& coarse) {
  if (margins.empty()) return;
  const std::vector<Vector3> points = resampled(margins, design_from_dental);
  const Vector3 size = coarse.spacing_mm * (coarse.nodes.cast<double>() - Vector3::Ones());
  origin_ = coarse.origin_mm;
  nx_ = static_cast<int>(std::ceil(size.x() / spacing_)) + 2;
  ny_ = static_cast<int>(std::ceil(size.y() / spacing_)) + 2;
  height_.assign(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_), 0.0f);
  weight_ = height_;
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      const Eigen::Vector2d q = origin_.head<2>() + spacing_ * Eigen::Vector2d(i, j);
      double nearest = 1e300, sum = 0.0, weighted = 0.0;
      for (const Vector3& p : points) {
        const double d2 = (p.head<2>() - q).squaredNorm();
        nearest = std::min(nearest, d2);
        const double w = 1.0 / ((d2 + 1e-4) * (d2 + 1e-4));
        sum += w;
        weighted += w * p.z();
      }
      const double t = std::clamp((std::sqrt(nearest) - kMarginReachMm) / kFadeMm, 0.0, 1.0);
      const std::size_t at =
          static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j);
      height_[at] = static_cast<float>(weighted / sum);
      weight_[at] = static_cast<float>(1.0 - t * t * (3.0 - 2.0 * t));
    }
  });
}

double MarginSurface::cut_mm(const Vector3& p, double otherwise_mm) const {
  const double u = std::clamp((p.x() - origin_.x()) / spacing_, 0.0, nx_ - 1.001);
  const double v = std::clamp((p.y() - origin_.y()) / spacing_, 0.0, ny_ - 1.001);
  const int i = static_cast<int>(u), j = static_cast<int>(v);
  const double fu = u - i, fv = v - j;
  const auto sample = [&](const std::vector<float>& values) {
    const auto at = [&](int a, int b) {
      return static_cast<double>(
          values[static_cast<std::size_t>(a) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(b)]);
    };
    return (1 - fu) * ((1 - fv) * at(i, j) + fv * at(i, j + 1)) +
           fu * ((1 - fv) * at(i + 1, j) + fv * at(i + 1, j + 1));
  };
  const double weight = sample(weight_);
  return weight <= 0.0 ? otherwise_mm : (1.0 - weight) * otherwise_mm + weight * sample(height_);
}

}  // namespace gnathion
