#include "tracking/tag_side.h"

namespace gnathion {
namespace {

constexpr double kLeastRiseGrey = 7.5;  // over two pixels
constexpr double kMinSidePx = 10;
constexpr double kMinCellPx = 1.6;

/// A point of the tag's plane, `i` cells along side `k` in its direction and `depth` cells inward of it.
Vector2 cell_point(const Matrix3& h, int n, int k, double i, double depth) {
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
}

/// Whether cell `i` of the first data row along side `k` is white.
bool inner_white(const TagFamily& family, int id, int k, int i) {
  const int n = family.square_cells();
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
}

bool has_distortion(const CameraModel& c) {
  return c.k1 != 0 || c.k2 != 0 || c.k3 != 0 || c.p1 != 0 || c.p2 != 0;
}

}  // namespace

double InnerRow::white(double s_px, double blur_px) const {
  double w = 0;
  for (std::size_t r = 0; r < static_cast<std::size_t>(runs); ++r) {
    w += kNormal.cumulative((s_px - from_px[r]) / blur_px) - kNormal.cumulative((s_px - to_px[r]) / blur_px);
  }
  return w;
}

InnerRow inner_row(const Side& side, const Matrix3& h, const TagFamily& family, int id, int k) {
  const int n = family.square_cells();
  InnerRow row;
  for (int i = 1; i + 1 < n && row.runs < InnerRow::kMostRuns; ++i) {
    if (!inner_white(family, id, k, i)) continue;
    int last = i;
    while (last + 2 < n && inner_white(family, id, k, last + 1)) ++last;
    const std::size_t r = static_cast<std::size_t>(row.runs++);
    row.from_px[r] = side.along.dot(cell_point(h, n, k, i, 1.0) - side.start);
    row.to_px[r] = side.along.dot(cell_point(h, n, k, last + 1, 1.0) - side.start);
    i = last;
  }
  return row;
}

bool make_sides(const CameraModel& camera, const TagFamily& family, const TagCorners& corners,
                const Matrix3& h, std::array<Side, 4>* sides) {
  const int n = family.square_cells();
  const bool distorted = has_distortion(camera);
  TagCorners straight;  // without the lens' distortion
  for (std::size_t k = 0; distorted && k < 4; ++k) straight[k] = camera.undistorted(corners[k]);
  for (int k = 0; k < 4; ++k) {
    const std::size_t from = static_cast<std::size_t>(k), to = (from + 1) % 4;
    Side& side = (*sides)[from];
    side.start = corners[from];
    side.length_px = (corners[to] - corners[from]).norm();
    if (!(side.length_px >= kMinSidePx)) return false;
    side.along = (corners[to] - corners[from]) / side.length_px;
    side.normal = Vector2(-side.along.y(), side.along.x());
    side.sagitta_px = 0;
    if (distorted) {  // how far the straight edge bows out of its chord, at its middle
      const Vector2 middle = camera.distort(0.5 * (straight[from] + straight[to]));
      const Vector2 pixel(camera.fx_px * middle.x() + camera.cx_px, camera.fy_px * middle.y() + camera.cy_px);
      side.sagitta_px = side.normal.dot(pixel - 0.5 * (corners[from] + corners[to]));
    }
    // Parallel lines one cell inside and outside: their distance is linear along the side.
    const auto distances = [&](double depth, double* at_0, double* at_1) {
      const Vector2 p = cell_point(h, n, k, 0, depth) - side.start;
      const Vector2 q = cell_point(h, n, k, n, depth) - side.start;
      const double s0 = side.along.dot(p), s1 = side.along.dot(q);
      const double d0 = side.normal.dot(p), d1 = side.normal.dot(q);
      const double slope = (d1 - d0) / (s1 - s0);
      *at_0 = d0 - slope * s0;
      *at_1 = d0 + slope * (side.length_px - s0);
    };
    distances(-1, &side.out0, &side.out1);
    distances(1, &side.in0, &side.in1);
    side.in0 = -side.in0;
    side.in1 = -side.in1;
    if (!(side.least_cell() >= kMinCellPx)) return false;
  }
  return true;
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
