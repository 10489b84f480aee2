#include "tracking/tag_side.h"

namespace gnathion {
namespace {

constexpr double kLeastRiseGrey = 7.5;  // over two pixels
constexpr double kMinSidePx = 10;
constexpr double kMinCellPx = 1.6;

/// How far a straight edge of space bows out of its chord in the image, at its middle.
double sagitta(const CameraModel& camera, const Vector2& a, const Vector2& b, const Vector2& normal) {
  if (camera.k1 == 0 && camera.k2 == 0 && camera.k3 == 0 && camera.p1 == 0 && camera.p2 == 0) return 0;
  const Vector2 middle = camera.distort(0.5 * (camera.undistorted(a) + camera.undistorted(b)));
  const Vector2 pixel(camera.fx_px * middle.x() + camera.cx_px, camera.fy_px * middle.y() + camera.cy_px);
  return normal.dot(pixel - 0.5 * (a + b));
}

}  // namespace

std::vector<double> inner_row(const Side& side, const Matrix3& h, const TagFamily& family, int id, int k,
                              double blur_px) {
  const int n = family.square_cells();
  const auto cell_point = [&](double i, double depth) {  // i along the side in its direction, depth inward
    switch (k) {
      case 0:
        return apply(h, i, n - depth);
      case 1:
        return apply(h, n - depth, n - i);
      case 2:
        return apply(h, n - i, depth);
      default:
        return apply(h, depth, i);
    }
  };
  const auto white = [&](int i) {
    switch (k) {
      case 0:
        return family.white(id, i, n - 2);
      case 1:
        return family.white(id, n - 2, n - 1 - i);
      case 2:
        return family.white(id, n - 1 - i, 1);
      default:
        return family.white(id, 1, i);
    }
  };
  std::vector<double> w(static_cast<std::size_t>(side.length_px * kGrid) + 3, 0.0);
  for (int i = 1; i + 1 < n; ++i) {
    if (!white(i)) continue;
    int last = i;
    while (last + 2 < n && white(last + 1)) ++last;
    const double from = side.along.dot(cell_point(i, 1.0) - side.start);
    const double to = side.along.dot(cell_point(last + 1, 1.0) - side.start);
    for (std::size_t g = 0; g < w.size(); ++g) {
      const double s = static_cast<double>(g) / kGrid;
      w[g] += kNormal.cumulative((s - from) / blur_px) - kNormal.cumulative((s - to) / blur_px);
    }
    i = last;
  }
  return w;
}

std::optional<Side> make_side(const CameraModel& camera, const TagFamily& family, const TagCorners& corners,
                              const Matrix3& h, int k) {
  Side side;
  const Vector2& a = corners[static_cast<std::size_t>(k)];
  const Vector2& b = corners[static_cast<std::size_t>((k + 1) % 4)];
  side.start = a;
  side.length_px = (b - a).norm();
  if (!(side.length_px >= kMinSidePx)) return std::nullopt;
  side.along = (b - a) / side.length_px;
  side.normal = Vector2(-side.along.y(), side.along.x());
  side.sagitta_px = sagitta(camera, a, b, side.normal);
  // Parallel lines one cell inside and outside: their distance is linear along the side.
  const int n = family.square_cells();
  const auto depth_point = [&](double i, double depth) {
    switch (k) {
      case 0:
        return apply(h, i, n - depth);
      case 1:
        return apply(h, n - depth, n - i);
      case 2:
        return apply(h, n - i, depth);
      default:
        return apply(h, depth, i);
    }
  };
  const auto distance_at = [&](double depth, double u) {
    const Vector2 p = depth_point(0, depth) - a, q = depth_point(n, depth) - a;
    const double s0 = side.along.dot(p), s1 = side.along.dot(q);
    const double d0 = side.normal.dot(p), d1 = side.normal.dot(q);
    return d0 + (d1 - d0) * (u * side.length_px - s0) / (s1 - s0);
  };
  side.in0 = -distance_at(1, 0);
  side.in1 = -distance_at(1, 1);
  side.out0 = distance_at(-1, 0);
  side.out1 = distance_at(-1, 1);
  if (!(side.least_cell() >= kMinCellPx)) return std::nullopt;
  return side;
}

bool find_edge(const Image8& image, const Side& side, double* offset, double* slope) {
  constexpr int kProfiles = 9, kMinInliers = 6;
  std::array<double, kProfiles> at{}, v{};
  int found = 0;
  for (int i = 0; i < kProfiles; ++i) {
    const double u = 0.12 + 0.76 * i / (kProfiles - 1);
    const double reach = std::min(7.0, 1.4 * std::min(side.cell_in(u), side.cell_out(u)) + 0.5);
    const Vector2 foot =
        side.start + u * side.length_px * side.along + 4 * side.sagitta_px * u * (1 - u) * side.normal;
    const int steps = static_cast<int>(reach);
    if (!inside(image, foot + (steps + 1) * side.normal, 1) ||
        !inside(image, foot - (steps + 1) * side.normal, 1)) {
      continue;
    }
    std::array<double, 18> grey{};
    for (int s = -steps - 1; s <= steps + 1; ++s) {
      grey[static_cast<std::size_t>(s + steps + 1)] = sample(image, foot + s * side.normal);
    }
    double best = kLeastRiseGrey, where = 0;
    bool any = false;
    for (int s = -steps; s <= steps; ++s) {
      const std::size_t g = static_cast<std::size_t>(s + steps + 1);
      const double rise = grey[g + 1] - grey[g - 1];
      if (rise > best) {
        best = rise;
        const double before = grey[g] - (g >= 2 ? grey[g - 2] : grey[0]);
        const double after = (g + 2 < grey.size() && s < steps ? grey[g + 2] : grey[g + 1]) - grey[g];
        const double bend = before - 2 * rise + after;
        where = s + (bend < -1e-9 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0.0);
        any = true;
      }
    }
    if (!any) continue;
    at[static_cast<std::size_t>(found)] = where;
    v[static_cast<std::size_t>(found)] = u - 0.5;
    ++found;
  }
  if (found < kMinInliers) return false;
  // The line through two profiles that most others agree with, then least squares over those.
  const auto agrees = [&](int i, double a, double b) {
    return std::abs(at[static_cast<std::size_t>(i)] - a - b * v[static_cast<std::size_t>(i)]) < 0.8;
  };
  int most = 0;
  double best_a = 0, best_b = 0;
  for (int i = 0; i < found; ++i) {
    for (int j = i + 2; j < found; ++j) {
      const std::size_t p = static_cast<std::size_t>(i), q = static_cast<std::size_t>(j);
      const double b = (at[q] - at[p]) / (v[q] - v[p]), a = at[p] - b * v[p];
      int count = 0;
      for (int m = 0; m < found; ++m) count += agrees(m, a, b);
      if (count > most) most = count, best_a = a, best_b = b;
    }
  }
  if (most < kMinInliers) return false;
  double n = 0, sv = 0, svv = 0, sd = 0, sdv = 0;
  for (int i = 0; i < found; ++i) {
    if (!agrees(i, best_a, best_b)) continue;
    const double vi = v[static_cast<std::size_t>(i)], di = at[static_cast<std::size_t>(i)];
    n += 1, sv += vi, svv += vi * vi, sd += di, sdv += di * vi;
  }
  const double determinant = n * svv - sv * sv;
  *slope = (n * sdv - sv * sd) / determinant;
  *offset = (sd - *slope * sv) / n;
  return true;
}

}  // namespace gnathion
