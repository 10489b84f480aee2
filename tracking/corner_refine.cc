#include "tracking/corner_refine.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "tracking/tag_side.h"

namespace gnathion {
namespace {

constexpr int kParameters = 7;  // a, b, σ, B, B', C, C'
using Vector7 = Eigen::Matrix<double, kParameters, 1>;
using Matrix7 = Eigen::Matrix<double, kParameters, kParameters>;

constexpr double kMinContrastGrey = 15;

struct EdgeFit {
  Vector7 x = Vector7::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< of a, b
  double noise_grey = 0;
  double blur_px() const { return x[2]; }
  double contrast_grey() const { return x[5]; }
};

/// Calls visit(grey, u, d) for each pixel of the strip −in(u) ≤ d ≤ out(u), away from the corners.
template <class Visit>
bool for_strip(const Image8& image, const Side& side, double reach_px, double blur_px, Visit&& visit) {
  const double end_margin = std::min(1.0 + 2.0 * blur_px, 0.25 * side.length_px);
  const double u_min = end_margin / side.length_px, u_max = 1 - u_min;
  const double out_most = std::max(side.out0, side.out1);
  const double reach = std::min(reach_px, out_most + 4) + std::abs(side.sagitta_px);
  const Vector2 ends[4] = {side.start + reach * side.normal, side.start - reach * side.normal,
                           side.start + side.length_px * side.along + reach * side.normal,
                           side.start + side.length_px * side.along - reach * side.normal};
  for (const Vector2& e : ends) {
    if (!inside(image, e, 0)) return false;
  }
  const bool by_column = std::abs(side.along.x()) >= std::abs(side.along.y());
  const int major = by_column ? 0 : 1, minor = 1 - major;
  const Vector2 last = side.start + side.length_px * side.along;
  const int from = static_cast<int>(std::ceil(std::min(side.start[major], last[major])));
  const int to = static_cast<int>(std::floor(std::max(side.start[major], last[major])));
  const double half = reach / std::abs(side.normal[minor]);
  for (int i = from; i <= to; ++i) {
    const double on_line =
        side.start[minor] + (i - side.start[major]) * side.along[minor] / side.along[major];
    const int lo = std::max(0, static_cast<int>(std::ceil(on_line - half)));
    const int hi = std::min((by_column ? image.height_px : image.width_px) - 1,
                            static_cast<int>(std::floor(on_line + half)));
    for (int j = lo; j <= hi; ++j) {
      const Vector2 p = by_column ? Vector2(i, j) : Vector2(j, i);
      double u;
      const double d = side.distance(p, &u);
      if (u < u_min || u > u_max) continue;
      const double inner = std::min(reach_px, side.cell_in(u));
      const double outer = std::min(reach_px, std::max(side.cell_out(u) - 1.5 * blur_px, 1.0));
      if (d < -inner || d > outer) continue;
      visit(static_cast<double>(by_column ? image.at(i, j) : image.at(j, i)), u, d);
    }
  }
  return true;
}

/// A pixel of a strip, with all of it that stays fixed while its edge is fitted.
struct StripPixel {
  double grey, v, distance, cell_in, inner_white;
};
using Strip = std::vector<StripPixel>;

bool gather(const Image8& image, const Side& side, double reach_px, double blur_px, Strip* strip) {
  strip->clear();
  const double per_u = side.length_px * kGrid;
  return for_strip(image, side, reach_px, blur_px, [&](double grey, double u, double d) {
    StripPixel p{grey, u - 0.5, d, side.cell_in(u), 0};
    const double where = u * per_u;
    const std::size_t k = static_cast<std::size_t>(where);
    const double f = where - static_cast<double>(k);
    p.inner_white = side.inner_white[k] * (1 - f) + side.inner_white[k + 1] * f;
    strip->push_back(p);
  });
}

/// One linearisation at `x`: Σ (J r)ᵀ(J r), that is the normal matrix, the gradient and the squared residuals
/// at once.
Matrix8 accumulate(const Strip& strip, const Vector7& x) {
  Matrix8 sum = Matrix8::Zero();
  const double inverse_sigma = 1 / x[2];
  for (const StripPixel& p : strip) {
    const double z = (p.distance - x[0] - x[1] * p.v) * inverse_sigma;
    const double density = kNormal.density(z);
    double profile = kNormal.cumulative(z), slope = density, spread = density * z;
    const double zi = -z - p.cell_in * inverse_sigma;
    if (zi > -3.5) {
      const double inner_density = p.inner_white * kNormal.density(zi);
      profile += p.inner_white * kNormal.cumulative(zi);
      slope -= inner_density;
      spread += inner_density * zi;
    }
    const double contrast = x[5] + x[6] * p.v;
    const double da = -contrast * slope * inverse_sigma;
    Eigen::Matrix<double, 8, 1> j;
    j << da, da * p.v, -contrast * spread * inverse_sigma, 1, p.v, profile, profile * p.v,
        p.grey - (x[3] + x[4] * p.v + contrast * profile);
    sum.noalias() += j * j.transpose();
  }
  return sum;
}

double reach_of(double blur_px) {
  return std::clamp(2.6 * blur_px + 0.6, 2.2, 7.0);
}

/// Gauss–Newton over the strip from `fit` on. `strip` is working memory.
bool fit_edge(const Image8& image, const Side& side, int iterations, Strip* strip, EdgeFit* fit) {
  const double blur_limit = 0.8 * side.least_cell() + 0.4;
  const double strip_blur = std::min(fit->x[2], blur_limit);
  // The set of pixels stays fixed while iterating.
  if (!gather(image, side, reach_of(strip_blur), strip_blur, strip)) return false;
  const int count = static_cast<int>(strip->size());
  if (count < 3 * kParameters) return false;
  for (int i = 0;; ++i) {
    const Matrix8 sum = accumulate(*strip, fit->x);
    const Matrix7 n = sum.topLeftCorner<7, 7>();
    const Eigen::LDLT<Matrix7, Eigen::Lower> solver(n);
    if (solver.info() != Eigen::Success || !solver.isPositive()) return false;
    Vector7 step = solver.solve(sum.topRightCorner<7, 1>());
    if (!step.allFinite()) return false;
    const double longest = std::max(std::abs(step[0]), 0.5 * std::abs(step[1]));
    if (longest > 1.0) step *= 1.0 / longest;
    step[2] = std::clamp(step[2], -0.4 * fit->x[2], 0.7 * fit->x[2]);
    fit->x += step;
    fit->x[2] = std::clamp(fit->x[2], 0.25, std::max(blur_limit, 0.6));
    const bool settled = longest < 2e-3;
    if (settled || i + 1 >= iterations) {
      const double variance = sum(7, 7) / (count - kParameters);
      fit->noise_grey = std::sqrt(variance);
      fit->covariance = variance * solver.solve(Matrix7::Identity()).topLeftCorner<2, 2>();
      return true;
    }
  }
}

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

std::optional<TagCorners> crossings(const std::array<Side, 4>& sides, const std::array<EdgeFit, 4>& fits,
                                    Matrix8* covariance) {
  TagCorners corners;
  Eigen::Matrix<double, 8, 8> map = Matrix8::Zero(), errors = Matrix8::Zero();
  for (int k = 0; k < 4; ++k) {
    const int b = (k + 3) % 4;
    const std::size_t before = static_cast<std::size_t>(b), after = static_cast<std::size_t>(k);
    Eigen::Matrix<double, 2, 4> m;
    const auto p = crossing(sides[before], fits[before], sides[after], fits[after], &m);
    if (!p) return std::nullopt;
    corners[after] = *p;
    map.block<2, 2>(2 * k, 2 * b) = m.leftCols<2>();
    map.block<2, 2>(2 * k, 2 * k) = m.rightCols<2>();
    errors.block<2, 2>(2 * k, 2 * k) = fits[after].covariance;
  }
  if (covariance != nullptr) *covariance = map * errors * map.transpose();
  return corners;
}

bool convex(const TagCorners& c) {
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector2 a = c[(k + 1) % 4] - c[k], b = c[(k + 2) % 4] - c[(k + 1) % 4];
    if (!(a.x() * b.y() - a.y() * b.x() < 0)) return false;  // counter-clockwise as seen, y down
  }
  return true;
}

bool make_sides(const CameraModel& camera, const TagFamily& family, const TagCorners& corners, Matrix3* h,
                std::array<Side, 4>* sides) {
  if (!convex(corners)) return false;
  *h = pixels_from_cells(corners, family.square_cells());
  for (int k = 0; k < 4; ++k) {
    auto side = make_side(camera, family, corners, *h, k);
    if (!side) return false;
    (*sides)[static_cast<std::size_t>(k)] = std::move(*side);
  }
  return true;
}

/// Corners to about half a pixel, from profiles.
std::optional<TagCorners> snap(const Image8& image, const CameraModel& camera, const TagFamily& family,
                               const TagCorners& start) {
  std::array<Side, 4> sides;
  std::array<EdgeFit, 4> fits;
  Matrix3 h;
  if (!make_sides(camera, family, start, &h, &sides)) return std::nullopt;
  for (std::size_t k = 0; k < 4; ++k) {
    if (!find_edge(image, sides[k], &fits[k].x[0], &fits[k].x[1])) return std::nullopt;
  }
  return crossings(sides, fits, nullptr);
}

/// Black and white levels at the start of a fit, from the strip's inner and outer halves.
void start_levels(const Image8& image, const Side& side, EdgeFit* fit) {
  double black = 0, white = 0;
  int blacks = 0, whites = 0;
  for_strip(image, side, reach_of(fit->x[2]), fit->x[2], [&](double grey, double, double d) {
    if (d < -1) black += grey, ++blacks;
    if (d > 1) white += grey, ++whites;
  });
  fit->x[3] = blacks ? black / blacks : 0;
  fit->x[5] = (whites ? white / whites : 255) - fit->x[3];
}

bool plausible(const Side& side, const EdgeFit& fit) {
  return fit.contrast_grey() >= kMinContrastGrey && fit.noise_grey <= 4.0 + 0.10 * fit.contrast_grey() &&
         fit.blur_px() <= 0.8 * side.least_cell() + 0.35 && std::abs(fit.x[0]) <= 3 &&
         std::abs(fit.x[1]) <= 4;
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
                                             const TagFamily& family, int id, const TagCorners& start_px) {
  auto corners = snap(image, camera, family, start_px);
  if (!corners) return std::nullopt;
  std::array<Side, 4> sides;
  std::array<EdgeFit, 4> fits;
  RefinedCorners result;
  Strip strip;
  for (int pass = 0; pass < 2; ++pass) {  // the second pass cuts its strips where the first found the edges
    Matrix3 h;
    if (!make_sides(camera, family, *corners, &h, &sides)) return std::nullopt;
    for (int k = 0; k < 4; ++k) {
      Side& side = sides[static_cast<std::size_t>(k)];
      EdgeFit& fit = fits[static_cast<std::size_t>(k)];
      if (pass == 0) fit.x[2] = 0.9;
      side.inner_white = inner_row(side, h, family, id, k, fit.x[2]);
      if (pass == 0) start_levels(image, side, &fit);
      fit.x[0] = fit.x[1] = 0;
      if (!fit_edge(image, side, pass == 0 ? 4 : 8, &strip, &fit)) return std::nullopt;
      if (pass == 1 && !plausible(side, fit)) return std::nullopt;
    }
    corners = crossings(sides, fits, pass == 1 ? &result.covariance_px2 : nullptr);
    if (!corners || !convex(*corners)) return std::nullopt;
  }
  result.corners_px = *corners;
  for (const EdgeFit& fit : fits) {
    result.black_grey += 0.25 * fit.x[3];
    result.contrast_grey += 0.25 * fit.x[5];
    result.noise_grey += 0.25 * fit.noise_grey;
    result.blur_px = std::max(result.blur_px, fit.blur_px());
  }
  return result;
}

BitCheck check_bits(const Image8& image, const TagFamily& family, int id, const RefinedCorners& corners) {
  const int n = family.square_cells();
  const Matrix3 h = pixels_from_cells(corners.corners_px, n);
  const double threshold = corners.black_grey + 0.5 * corners.contrast_grey;
  BitCheck check;
  int bits = 0;
  for (int y = 1; y + 1 < n; ++y) {
    for (int x = 1; x + 1 < n; ++x, ++bits) {
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
