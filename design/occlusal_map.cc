#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/preparation.h"

namespace gnathion {
namespace {

constexpr double kElsewhere = 1e3;

constexpr double kHalfWidthMm = 8.0;  // of the crowns about the arch curve
constexpr double kWindowMm = 3.0;     // along the arch, to each side of a station
constexpr double kStationMm = 1.0;
constexpr double kSmoothingMm = 3.0;    // Gaussian along the arch
constexpr double kSteepestTilt = 0.65;  // a steeper support is the palatal slope of a front tooth, no tilt
constexpr double kShortestEdgeMm = 2.5;
constexpr int kPasses = 2;  // z may be tilted against the plane in which the arch is measured

struct Support {
  double height_mm = 0.0;  ///< at the arch curve
  double tilt = 0.0;       ///< per mm to buccal
  bool known = false;
};

/// The longest edge of the lower convex hull of (buccal, height) points: what a flat plate pressed against
/// the crowns would rest on.
Support support_of(std::vector<Eigen::Vector2d> points) {
  if (points.size() < 10) return {};
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y()); });
  std::vector<Eigen::Vector2d> hull;
  for (const Eigen::Vector2d& p : points) {
    while (hull.size() >= 2) {
      const Eigen::Vector2d u = hull.back() - hull[hull.size() - 2], v = p - hull.back();
      if (u.x() * v.y() - u.y() * v.x() > 0.0) break;
      hull.pop_back();
    }
    hull.push_back(p);
  }
  Support support;
  support.known = true;
  const auto lowest =
      *std::min_element(hull.begin(), hull.end(), [](const auto& a, const auto& b) { return a.y() < b.y(); });
  support.height_mm = lowest.y();
  double longest = kShortestEdgeMm;
  for (std::size_t i = 0; i + 1 < hull.size(); ++i) {
    const Eigen::Vector2d edge = hull[i + 1] - hull[i];
    const double tilt = edge.y() / std::max(1e-9, edge.x());
    if (edge.norm() <= longest || std::abs(tilt) > kSteepestTilt) continue;
    longest = edge.norm();
    support.tilt = tilt;
    support.height_mm = hull[i].y() - tilt * hull[i].x();
  }
  return support;
}

/// Gaussian mean of the known stations.
std::vector<Support> smoothed(const std::vector<Support>& stations) {
  std::vector<Support> out(stations.size());
  for (std::size_t i = 0; i < stations.size(); ++i) {
    double weight = 0.0;
    for (std::size_t j = 0; j < stations.size(); ++j) {
      if (!stations[j].known) continue;
      const double d = (static_cast<double>(i) - static_cast<double>(j)) * kStationMm / kSmoothingMm;
      const double w = std::exp(-0.5 * d * d) + 1e-12;
      weight += w;
      out[i].height_mm += w * stations[j].height_mm;
      out[i].tilt += w * stations[j].tilt;
    }
    if (weight > 0.0) out[i] = {out[i].height_mm / weight, out[i].tilt / weight, true};
  }
  return out;
}

std::vector<Support> supports_along(const TriangleMesh& support, const ArchRuler& ruler,
                                    const Rigid3& dental_from_design) {
  const double first = ruler.s_min_mm();
  const auto count = static_cast<std::size_t>((ruler.s_max_mm() - first) / kStationMm) + 1;
  std::vector<ArchCoordinates> where(support.vertices_mm.size());
  parallel_each(where.size(), [&](std::size_t v) {
    where[v] = ruler.measure(dental_from_design * support.vertices_mm[v]);
  });
  std::vector<std::vector<Eigen::Vector2d>> points(count);
  for (std::size_t v = 0; v < where.size(); ++v) {
    const ArchCoordinates& c = where[v];
    if (std::abs(c.buccal_mm) > kHalfWidthMm) continue;
    const double low = (c.s_mm - kWindowMm - first) / kStationMm,
                 high = (c.s_mm + kWindowMm - first) / kStationMm;
    for (int i = std::max(0, static_cast<int>(std::ceil(low)));
         i <= std::min(static_cast<int>(count) - 1, static_cast<int>(std::floor(high))); ++i)
      points[static_cast<std::size_t>(i)].emplace_back(c.buccal_mm, support.vertices_mm[v].z());
  }
  std::vector<Support> stations(count);
  parallel_each(count, [&](std::size_t i) { stations[i] = support_of(std::move(points[i])); });
  return smoothed(stations);
}

/// Height of the ruled surface, between two stations.
double height_at(const std::vector<Support>& stations, const ArchCoordinates& c, double s_min_mm) {
  const double u =
      std::clamp((c.s_mm - s_min_mm) / kStationMm, 0.0, static_cast<double>(stations.size()) - 1.001);
  const auto n = static_cast<std::size_t>(u);
  const double t = u - static_cast<double>(n);
  const Support& a = stations[n];
  const Support& b = stations[std::min(n + 1, stations.size() - 1)];
  const double across = std::clamp(c.buccal_mm, -kHalfWidthMm, kHalfWidthMm);
  return (1 - t) * (a.height_mm + a.tilt * across) + t * (b.height_mm + b.tilt * across);
}

}  // namespace

OcclusalMap::OcclusalMap(const TriangleMesh& support, const ArchFrame& frame,
                         const Rigid3& design_from_dental, const CoveredArc& covered) {
  const ArchRuler ruler(frame);
  const Rigid3 dental_from_design = design_from_dental.inverse();
  const std::vector<Support> stations = supports_along(support, ruler, dental_from_design);
  const Box box = bounding_box(support);
  origin_ = box.min_mm;
  nx_ = static_cast<int>(std::ceil(box.size_mm().x() / spacing_)) + 2;
  ny_ = static_cast<int>(std::ceil(box.size_mm().y() / spacing_)) + 2;
  level_.resize(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_));
  off_.resize(level_.size());
  behind_.resize(level_.size());
  beyond_.resize(level_.size());
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      Vector3 p = origin_ + spacing_ * Vector3(i, j, 0);
      p.z() = 0.0;
      ArchCoordinates c;
      for (int pass = 0; pass < kPasses; ++pass) {
        c = ruler.measure(dental_from_design * p);
        p.z() = height_at(stations, c, ruler.s_min_mm());
      }
      const std::size_t at =
          static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j);
      level_[at] = static_cast<float>(p.z());
      off_[at] = static_cast<float>(c.buccal_mm);
      const double right = covered.right_mm - c.s_mm, left = c.s_mm - covered.left_mm;
      const double front = covered.right_front_mm < covered.left_front_mm
                               ? std::min(c.s_mm - covered.right_front_mm, covered.left_front_mm - c.s_mm)
                               : -kElsewhere;
      behind_[at] = static_cast<float>(
          std::max(covered.right_last ? right : -kElsewhere, covered.left_last ? left : -kElsewhere));
      beyond_[at] = static_cast<float>(std::max(
          {covered.right_last ? -kElsewhere : right, covered.left_last ? -kElsewhere : left, front}));
    }
  });
}

double OcclusalMap::sample(const std::vector<float>& values, const Vector3& p_mm) const {
  const double u = std::clamp((p_mm.x() - origin_.x()) / spacing_, 0.0, nx_ - 1.001);
  const double v = std::clamp((p_mm.y() - origin_.y()) / spacing_, 0.0, ny_ - 1.001);
  const int i = static_cast<int>(u), j = static_cast<int>(v);
  const double fu = u - i, fv = v - j;
  const auto at = [&](int a, int b) {
    return static_cast<double>(
        values[static_cast<std::size_t>(a) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(b)]);
  };
  return (1 - fu) * ((1 - fv) * at(i, j) + fv * at(i, j + 1)) +
         fu * ((1 - fv) * at(i + 1, j) + fv * at(i + 1, j + 1));
}

double OcclusalMap::level_mm(const Vector3& p_design_mm) const {
  return sample(level_, p_design_mm);
}
double OcclusalMap::off_curve_mm(const Vector3& p_design_mm) const {
  return sample(off_, p_design_mm);
}
double OcclusalMap::beyond_cover_mm(const Vector3& p_design_mm) const {
  return sample(beyond_, p_design_mm);
}
double OcclusalMap::behind_teeth_mm(const Vector3& p_design_mm) const {
  return sample(behind_, p_design_mm);
}

}  // namespace gnathion
