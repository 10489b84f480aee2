#include "tracking/corner_refine.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "tracking/corner_refine_fit.h"
#include "tracking/tag_side.h"

namespace gnathion {
namespace {

constexpr double kMinContrastGrey = 15;
constexpr int kMostMissingSides = 2;
constexpr double kMissingOffsetPx = 4;  // standard deviation of a side that is only predicted

/// Where two neighbouring sides, as fitted, cross; `m` takes d(corner)/d(a, b of `before`, a, b of `after`).
std::optional<Vector2> crossing(const Side& before, const EdgeFit& fit_before, const Side& after,
                                const EdgeFit& fit_after, Eigen::Matrix<double, 2, 4>* m) {
  Vector2 p = after.start;
  Eigen::Matrix2d j;
  double u0 = 0, u1 = 0;
  const auto value = [](const Side& side, const EdgeFit& fit, const Vector2& at, double* u,
                        Vector2* gradient) {
    const double d = side.distance(at, u);
    *gradient = side.normal - (4 * side.sagitta_px * (1 - 2 * *u) + fit.x[1]) / side.length_px * side.along;
    return d - fit.x[0] - fit.x[1] * (*u - 0.5);
  };
  for (int i = 0; i < 4; ++i) {
    Vector2 g0, g1, f;
    f[0] = value(before, fit_before, p, &u0, &g0);
    f[1] = value(after, fit_after, p, &u1, &g1);
    j.row(0) = g0;
    j.row(1) = g1;
    if (std::abs(j.determinant()) < 0.05) return std::nullopt;
    const Vector2 step = j.inverse() * f;
    p -= step;
    if (step.squaredNorm() < 1e-14) break;
  }
  if (m != nullptr) {
    const Eigen::Matrix2d inverse = j.inverse();
    m->col(0) = inverse.col(0);
    m->col(1) = inverse.col(0) * (u0 - 0.5);
    m->col(2) = inverse.col(1);
    m->col(3) = inverse.col(1) * (u1 - 0.5);
  }
  return p;
}

/// Corners from the four fitted sides. Neighbouring corners share a side and its error; opposite ones
/// nothing.
std::optional<TagCorners> crossings(const std::array<Side, 4>& sides, const std::array<EdgeFit, 4>& fits,
                                    Matrix8* covariance) {
  TagCorners corners;
  std::array<Eigen::Matrix<double, 2, 4>, 4> m;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t before = (k + 3) % 4;
    const auto p =
        crossing(sides[before], fits[before], sides[k], fits[k], covariance != nullptr ? &m[k] : nullptr);
    if (!p) return std::nullopt;
    corners[k] = *p;
  }
  if (covariance == nullptr) return corners;
  covariance->setZero();
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t before = (k + 3) % 4, next = (k + 1) % 4;
    const auto from_before = m[k].leftCols<2>(), from_own = m[k].rightCols<2>();
    const int row = static_cast<int>(2 * k), column = static_cast<int>(2 * next);
    covariance->block<2, 2>(row, row) = from_before * fits[before].covariance * from_before.transpose() +
                                        from_own * fits[k].covariance * from_own.transpose();
    const Eigen::Matrix2d shared = from_own * fits[k].covariance * m[next].leftCols<2>().transpose();
    covariance->block<2, 2>(row, column) = shared;
    covariance->block<2, 2>(column, row) = shared.transpose();
  }
  return corners;
}

bool convex(const TagCorners& c) {
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector2 a = c[(k + 1) % 4] - c[k], b = c[(k + 2) % 4] - c[(k + 1) % 4];
    if (!(a.x() * b.y() - a.y() * b.x() < 0)) return false;  // counter-clockwise as seen, y down
  }
  return true;
}

/// Corners to about half a pixel, from profiles.
std::optional<TagCorners> snap(const Image8& image, const CameraModel& camera, const TagFamily& family,
                               const TagCorners& start) {
  if (!convex(start)) return std::nullopt;
  std::array<Side, 4> sides;
  std::array<EdgeFit, 4> fits;
  if (!make_sides(camera, family, start, pixels_from_cells(start, family.square_cells()), &sides))
    return std::nullopt;
  for (std::size_t k = 0; k < 4; ++k) {
    if (!find_edge(image, sides[k], &fits[k].x[0], &fits[k].x[1])) return std::nullopt;
  }
  return crossings(sides, fits, nullptr);
}

bool plausible(const Side& side, const EdgeFit& fit) {
  return fit.contrast_grey() >= kMinContrastGrey && fit.noise_grey <= 4.0 + 0.10 * fit.contrast_grey() &&
         fit.blur_px() <= 0.8 * side.least_cell() + 0.35 && std::abs(fit.x[0]) <= 3 &&
         std::abs(fit.x[1]) <= 4;
}

/// A side of which nothing was seen: where it was expected, give or take some pixels.
EdgeFit missing_side() {
  EdgeFit fit;
  fit.x[2] = 0.75;
  fit.covariance =
      Vector2(kMissingOffsetPx * kMissingOffsetPx, 4 * kMissingOffsetPx * kMissingOffsetPx).asDiagonal();
  return fit;
}

/// One pass over the four sides, from `corners` and blurs to corners and fits.
class Pass {
 public:
  std::array<Side, 4> sides;
  std::array<EdgeFit, 4> fits;
  int missing = 0;

  bool run(const Image8& image, const CameraModel& camera, const TagFamily& family, int id,
           const TagCorners& corners, const std::array<float, 4>& blur_px, int most_missing,
           EdgeStrip* strip) {
    missing = 0;
    if (!convex(corners)) return false;
    const Matrix3 h = pixels_from_cells(corners, family.square_cells());
    if (!make_sides(camera, family, corners, h, &sides)) return false;
    for (std::size_t k = 0; k < 4; ++k) {
      const InnerRow row = inner_row(sides[k], h, family, id, static_cast<int>(k));
      const double blur = std::clamp(static_cast<double>(blur_px[k]), 0.3, 6.0);
      if (fit_edge(image, sides[k], row, blur, strip, &fits[k]) && plausible(sides[k], fits[k])) continue;
      if (++missing > most_missing) return false;
      fits[k] = missing_side();
    }
    return true;
  }
  /// The strips were cut where the edges are, and wide enough: another pass would tell the same.
  bool well_cut() const {
    return std::all_of(fits.begin(), fits.end(), [](const EdgeFit& f) {
      const double off = std::abs(f.x[0]) + 0.5 * std::abs(f.x[1]);
      return !f.fitted || (off < 0.5 && f.reach_px - off > 2.0 * f.blur_px());
    });
  }
  std::array<float, 4> blurs() const {
    return {static_cast<float>(fits[0].x[2]), static_cast<float>(fits[1].x[2]),
            static_cast<float>(fits[2].x[2]), static_cast<float>(fits[3].x[2])};
  }
};

RefinedCorners summary(const std::array<EdgeFit, 4>& fits) {
  RefinedCorners result;
  int fitted = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const EdgeFit& fit = fits[k];
    result.side_blur_px[k] = static_cast<float>(fit.x[2]);
    result.side_fitted[k] = fit.fitted;
    result.covered += 0.25 * (fit.fitted ? static_cast<double>(fit.covered) / kEdgeSegments : 1.0);
    if (!fit.fitted) continue;
    ++fitted;
    result.black_grey += fit.x[3];
    result.contrast_grey += fit.x[5];
    result.noise_grey += fit.noise_grey;
  }
  result.black_grey /= fitted;
  result.contrast_grey /= fitted;
  result.noise_grey /= fitted;
  return result;
}

}  // namespace

Matrix3 pixels_from_cells(const TagCorners& c, int square_cells) {
  // The unit square's map in closed form (Heckbert 1989, section 2.2.3), then cells.
  const Vector2 &p00 = c[3], &p10 = c[2], &p11 = c[1], &p01 = c[0];
  const Vector2 d1 = p10 - p11, d2 = p01 - p11, s = p00 - p10 + p11 - p01;
  const double determinant = d1.x() * d2.y() - d2.x() * d1.y();
  const double g = (s.x() * d2.y() - d2.x() * s.y()) / determinant;
  const double h = (d1.x() * s.y() - s.x() * d1.y()) / determinant;
  Matrix3 m;
  m << p10.x() - p00.x() + g * p10.x(), p01.x() - p00.x() + h * p01.x(), p00.x(),  //
      p10.y() - p00.y() + g * p10.y(), p01.y() - p00.y() + h * p01.y(), p00.y(),   //
      g, h, 1;
  m.leftCols<2>() /= square_cells;
  return m;
}

std::optional<RefinedCorners> refine_corners(const Image8& image, const CameraModel& camera,
                                             const TagFamily& family, int id, const CornerStart& start,
                                             EdgeStrip* strip) {
  TagCorners corners = start.corners_px;
  if (!start.predicted) {
    const auto snapped = snap(image, camera, family, corners);
    if (!snapped) return std::nullopt;
    corners = *snapped;
  }
  Pass pass;
  std::array<float, 4> blur_px = start.side_blur_px;
  constexpr int kMostPasses = 3;
  for (int i = 1;; ++i) {  // later passes cut their strips where the one before found the edges
    const int most_missing = start.predicted ? kMostMissingSides : 0;
    if (!pass.run(image, camera, family, id, corners, blur_px, most_missing, strip)) return std::nullopt;
    Matrix8 covariance;
    const auto found = crossings(pass.sides, pass.fits, &covariance);
    if (!found || !convex(*found)) return std::nullopt;
    corners = *found;
    if (!pass.well_cut() && i < kMostPasses) {
      blur_px = pass.blurs();
      continue;
    }
    RefinedCorners result = summary(pass.fits);
    result.corners_px = corners;
    result.covariance_px2 = covariance;
    return result;
  }
}

BitCheck check_bits(const Image8& image, const TagFamily& family, int id, const RefinedCorners& corners) {
  const int n = family.square_cells();
  const Matrix3 h = pixels_from_cells(corners.corners_px, n);
  const double threshold = corners.black_grey + 0.5 * corners.contrast_grey;
  BitCheck check;
  // Sides run from the lower left corner: below, right, above, left.
  const int x0 = corners.side_fitted[3] ? 1 : 2, x1 = corners.side_fitted[1] ? n - 1 : n - 2;
  const int y0 = corners.side_fitted[2] ? 1 : 2, y1 = corners.side_fitted[0] ? n - 1 : n - 2;
  int bits = 0;
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x, ++bits) {
      const Vector2 p = apply(h, x + 0.5, y + 0.5);
      if (!inside(image, p, 0)) {
        ++check.wrong;
        continue;
      }
      const double above = sample(image, p) - threshold;
      const double signed_margin = family.white(id, x, y) ? above : -above;
      check.wrong += signed_margin < 0;
      check.margin_grey += signed_margin;
    }
  }
  check.margin_grey /= bits;
  return check;
}

}  // namespace gnathion
