#include "design/imprint_limit.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kFallSlope = 1.19;  // 50°
constexpr double kStepMm = 0.05;     // of the search for the imprint's surface over the opposing arch
constexpr double kGridError = 0.4;   // of the spacing: of that surface, which comes from coarse grids
constexpr double kFarMm = 200.0;
constexpr int kMostHits = 8;
constexpr int kSmoothNodes = 1, kSmoothPasses = 2;
constexpr int kMarginNodes =
    kSmoothNodes * kSmoothPasses + 1;  // what smoothing and interpolation may take from the reach

/// Visits the nodes within `radius_mm` of (i, j), as offsets.
std::vector<std::pair<int, int>> disc(double radius_mm, double spacing_mm) {
  const int reach = static_cast<int>(std::ceil(radius_mm / spacing_mm));
  const double most = radius_mm * radius_mm / (spacing_mm * spacing_mm);
  std::vector<std::pair<int, int>> out;
  for (int i = -reach; i <= reach; ++i)
    for (int j = -reach; j <= reach; ++j)
      if (i * i + j * j <= most) out.emplace_back(i, j);
  return out;
}

/// Height over the foot, along `up`, of the splint's surface over the opposing arch; nothing where that is
/// farther than an imprint's.
std::optional<double> imprint_height(const Vector3& foot, const Vector3& up, double top_mm, double error_mm,
                                     const MeshQuery& opposing,
                                     const std::function<bool(const Vector3&)>& solid) {
  double from = 0.0;
  const Vector3 start = foot + top_mm * up;
  for (int n = 0; n < kMostHits; ++n) {
    const auto hit = opposing.ray(start, -up, from, kFarMm);
    if (!hit) return std::nullopt;
    from = hit->distance_mm + 1e-4;
    if (hit->normal.dot(up) <= 0.0) continue;
    for (double over = kStepMm; over <= kInImprintMm + error_mm; over += kStepMm)
      if (solid(hit->point_mm + over * up)) return top_mm - hit->distance_mm + over;
  }
  return std::nullopt;
}

}  // namespace

Matrix3 opening_axes(const Preparation& preparation) {
  Vector3 up = preparation.design_from_dental.rotation * preparation.arch.up;
  if (up.z() < 0.0) up = -up;  // on the mandible z points down
  Matrix3 axes;
  axes.col(2) = up;
  axes.col(0) = Vector3(Vector3::UnitX() - up * up.x()).normalized();
  axes.col(1) = up.cross(axes.col(0));
  return axes;
}

ImprintLimit::ImprintLimit(const Preparation& preparation, double depth_mm,
                           const std::function<bool(const Vector3&)>& solid)
    : axes_(opening_axes(preparation)), spacing_mm_(preparation.coarse.spacing_mm) {
  Box box;
  const GridShape& shape = preparation.coarse;
  for (int corner = 0; corner < 8; ++corner)
    box.extend(axes_.transpose() * shape.position(corner & 1 ? shape.nodes.x() - 1 : 0,
                                                  corner & 2 ? shape.nodes.y() - 1 : 0,
                                                  corner & 4 ? shape.nodes.z() - 1 : 0));
  low_ = box.min_mm;
  nx_ = static_cast<int>(box.size_mm().x() / spacing_mm_) + 2;
  ny_ = static_cast<int>(box.size_mm().y() / spacing_mm_) + 2;
  const std::size_t count = static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_);
  const Vector3 up = axes_.col(2);
  const double top_mm = box.size_mm().z(), error_mm = kGridError * spacing_mm_;

  std::vector<std::optional<double>> imprint(count);  // heights over low_
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j)
      imprint[static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j)] =
          imprint_height(axes_ * node(i, j), up, top_mm, error_mm, preparation.opposing, solid);
  });

  // The natural relief where an imprint is near.
  const auto near = disc(std::max(0.0, kImprintReachMm - spacing_mm_), spacing_mm_);
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  const double unset = 2.0 * kFarMm, none = 3.0 * kFarMm;
  std::vector<double> natural(count, none);
  const auto index = [&](int i, int j) {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j);
  };
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j)
      if (imprint[index(i, j)])
        for (const auto& [di, dj] : near)
          if (has_node(i + di, j + dj)) natural[index(i + di, j + dj)] = unset;
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      double& height = natural[index(i, j)];
      if (height != unset) continue;
      const Vector3 foot = axes_ * node(i, j) - kFarMm * up;
      const auto hit = preparation.stamp_source().ray(natural_from_tp * foot, natural_from_tp.rotation * up);
      height = hit ? hit->distance_mm - kFarMm : none;
    }
  });

  const double nothing = -kFarMm;
  floor_.assign(count, nothing);
  const auto beside = disc(kImprintReachMm + kMarginNodes * spacing_mm_, spacing_mm_);
  bool any = false;
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j) {
      if (!imprint[index(i, j)]) continue;
      any = true;
      double lowest = *imprint[index(i, j)];
      for (const auto& [di, dj] : near)
        if (has_node(i + di, j + dj)) lowest = std::min(lowest, natural[index(i + di, j + dj)]);
      const double floor = lowest - depth_mm + error_mm;
      for (const auto& [di, dj] : beside)
        if (has_node(i + di, j + dj)) at(i + di, j + dj) = std::max(at(i + di, j + dj), floor);
    }
  if (!any) {
    floor_.clear();
    return;
  }
  let_fall();
  smooth();
}

void ImprintLimit::let_fall() {
  const double straight = kFallSlope * spacing_mm_, askew = std::sqrt(2.0) * straight;
  const auto raise = [&](int i, int j, int di, int dj) {
    if (has_node(i + di, j + dj))
      at(i, j) = std::max(at(i, j), at(i + di, j + dj) - (di != 0 && dj != 0 ? askew : straight));
  };
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j) {
      raise(i, j, -1, 0);
      raise(i, j, 0, -1);
      raise(i, j, -1, -1);
      raise(i, j, -1, 1);
    }
  for (int i = nx_ - 1; i >= 0; --i)
    for (int j = ny_ - 1; j >= 0; --j) {
      raise(i, j, 1, 0);
      raise(i, j, 0, 1);
      raise(i, j, 1, 1);
      raise(i, j, 1, -1);
    }
}

void ImprintLimit::smooth() {
  for (int pass = 0; pass < 2 * kSmoothPasses; ++pass) {
    const bool along_x = pass % 2 == 0;
    const std::vector<double> before = floor_;
    for (int i = 0; i < nx_; ++i)
      for (int j = 0; j < ny_; ++j) {
        double sum = 0.0;
        for (int k = -kSmoothNodes; k <= kSmoothNodes; ++k) {
          const int a = std::clamp(i + (along_x ? k : 0), 0, nx_ - 1);
          const int b = std::clamp(j + (along_x ? 0 : k), 0, ny_ - 1);
          sum += before[static_cast<std::size_t>(a) * static_cast<std::size_t>(ny_) +
                        static_cast<std::size_t>(b)];
        }
        at(i, j) = sum / (2 * kSmoothNodes + 1);
      }
  }
}

double ImprintLimit::below_mm(const Vector3& p_mm) const {
  const Vector3 q = axes_.transpose() * p_mm - low_;
  const double x = std::clamp(q.x() / spacing_mm_, 0.0, nx_ - 1.001);
  const double y = std::clamp(q.y() / spacing_mm_, 0.0, ny_ - 1.001);
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const double u = x - i, v = y - j;
  const double floor = (1.0 - u) * ((1.0 - v) * at(i, j) + v * at(i, j + 1)) +
                       u * ((1.0 - v) * at(i + 1, j) + v * at(i + 1, j + 1));
  return (floor - q.z()) / std::hypot(1.0, kFallSlope);
}

}  // namespace gnathion
