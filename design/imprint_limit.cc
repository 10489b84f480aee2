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
constexpr double kBetween = 1.0 / 3.0;  // of the spacing: steep imprints are looked at between nodes, too
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
  const Heights imprint = imprints(box.size_mm().z(), preparation.opposing, solid);
  const bool any = std::any_of(imprint.begin(), imprint.end(), [](const auto& h) { return h.has_value(); });
  if (!any) return;
  raise(imprint, natural_relief(imprint, preparation), depth_mm - kGridError * spacing_mm_);
  let_fall();
  smooth();
}

/// By node, the highest imprint about it: on a slope the next node may lie a good deal lower, or miss it.
ImprintLimit::Heights ImprintLimit::imprints(double top_mm, const MeshQuery& opposing,
                                             const std::function<bool(const Vector3&)>& solid) const {
  const auto height_at = [&](const Vector3& p) {
    return imprint_height(axes_ * p, axes_.col(2), top_mm, kGridError * spacing_mm_, opposing, solid);
  };
  Heights at_node(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_));
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) at_node[index(i, j)] = height_at(node(i, j));
  });
  const auto near_imprint = [&](int i, int j) {
    for (int di = -1; di <= 1; ++di)
      for (int dj = -1; dj <= 1; ++dj)
        if (has_node(i + di, j + dj) && at_node[index(i + di, j + dj)]) return true;
    return false;
  };
  Heights highest = at_node;
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      if (!near_imprint(i, j)) continue;
      std::optional<double>& here = highest[index(i, j)];
      for (const double x : {-kBetween, 0.0, kBetween})
        for (const double y : {-kBetween, 0.0, kBetween})
          if (const auto height = height_at(node(i, j) + spacing_mm_ * Vector3(x, y, 0.0)))
            here = std::max(here.value_or(*height), *height);
    }
  });
  return highest;
}

/// Calls body(i, j, a, b) for the nodes (a, b) within reach of an imprint at (i, j).
template <class Body>
void ImprintLimit::each_near(const Heights& imprint, const Body& body) const {
  const auto near = disc(std::max(0.0, kImprintReachMm - spacing_mm_), spacing_mm_);
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j)
      if (imprint[index(i, j)])
        for (const auto& [di, dj] : near)
          if (has_node(i + di, j + dj)) body(i, j, i + di, j + dj);
}

/// By node within reach of an imprint, the height of the natural relief; kFarMm and more: none.
std::vector<double> ImprintLimit::natural_relief(const Heights& imprint,
                                                 const Preparation& preparation) const {
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  const Vector3 up = axes_.col(2);
  const double unset = 2.0 * kFarMm, none = 3.0 * kFarMm;
  std::vector<double> natural(imprint.size(), none);
  each_near(imprint, [&](int, int, int i, int j) { natural[index(i, j)] = unset; });
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      double& height = natural[index(i, j)];
      if (height != unset) continue;
      const Vector3 foot = axes_ * node(i, j) - kFarMm * up;
      const auto hit = preparation.stamp_source().ray(natural_from_tp * foot, natural_from_tp.rotation * up);
      height = hit ? hit->distance_mm - kFarMm : none;
    }
  });
  return natural;
}

/// The floor beside each imprint, `depth_mm` under the lowest place of relief or imprint.
void ImprintLimit::raise(const Heights& imprint, const std::vector<double>& natural, double depth_mm) {
  floor_.assign(imprint.size(), -kFarMm);
  std::vector<double> lowest(imprint.size());
  for (std::size_t c = 0; c < imprint.size(); ++c) lowest[c] = imprint[c].value_or(0.0);
  each_near(imprint, [&](int i, int j, int a, int b) {
    lowest[index(i, j)] = std::min(lowest[index(i, j)], natural[index(a, b)]);
  });
  const auto beside = disc(kImprintReachMm + kMarginNodes * spacing_mm_, spacing_mm_);
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j)
      if (imprint[index(i, j)])
        for (const auto& [di, dj] : beside)
          if (has_node(i + di, j + dj))
            at(i + di, j + dj) = std::max(at(i + di, j + dj), lowest[index(i, j)] - depth_mm);
}

void ImprintLimit::let_fall() {
  const double straight = kFallSlope * spacing_mm_, askew = std::sqrt(2.0) * straight;
  const auto lift = [&](int i, int j, int di, int dj) {
    if (has_node(i + di, j + dj))
      at(i, j) = std::max(at(i, j), at(i + di, j + dj) - (di != 0 && dj != 0 ? askew : straight));
  };
  for (int i = 0; i < nx_; ++i)
    for (int j = 0; j < ny_; ++j) {
      lift(i, j, -1, 0);
      lift(i, j, 0, -1);
      lift(i, j, -1, -1);
      lift(i, j, -1, 1);
    }
  for (int i = nx_ - 1; i >= 0; --i)
    for (int j = ny_ - 1; j >= 0; --j) {
      lift(i, j, 1, 0);
      lift(i, j, 0, 1);
      lift(i, j, 1, 1);
      lift(i, j, 1, -1);
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
