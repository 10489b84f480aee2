#include "tracking/board_saddle.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>

#include "tracking/tag_side.h"

namespace gnathion {
namespace {

constexpr int kParameters = 9;  // x0, y0, angle a, angle b, σ, c, m, gx, gy
using Vector9 = Eigen::Matrix<double, kParameters, 1>;
using Matrix9 = Eigen::Matrix<double, kParameters, kParameters>;
using Matrix10 = Eigen::Matrix<double, kParameters + 1, kParameters + 1>;

constexpr double kLeastRadiusPx = 2.0;
constexpr double kLeastContrastGrey = 15;
constexpr double kMostUnexplained = 0.15;  // of the variance
constexpr double kQuantisationGrey2 = 1.0 / 12;
constexpr double kFloorPx = 0.004;  // what the model does not see: the pixel's box, curved edges
constexpr int kIterations = 30;

struct Pixel {
  double x, y, grey;  // from the window's centre
};

std::vector<Pixel> disc(const Image8& image, const Vector2& centre, double radius_px) {
  std::vector<Pixel> pixels;
  const int x0 = static_cast<int>(std::ceil(centre.x() - radius_px));
  const int y0 = static_cast<int>(std::ceil(centre.y() - radius_px));
  const int x1 = static_cast<int>(std::floor(centre.x() + radius_px));
  const int y1 = static_cast<int>(std::floor(centre.y() + radius_px));
  if (x0 < 0 || y0 < 0 || x1 >= image.width_px || y1 >= image.height_px) return pixels;
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const double dx = x - centre.x(), dy = y - centre.y();
      if (dx * dx + dy * dy <= radius_px * radius_px)
        pixels.push_back({dx, dy, static_cast<double>(image.at(x, y))});
    }
  return pixels;
}

/// Normal matrix of (J | r) at x: gradient and squared residuals in its last column.
Matrix10 accumulate(const std::vector<Pixel>& pixels, const Vector9& x) {
  Matrix10 sum = Matrix10::Zero();
  const Vector2 na(-std::sin(x[2]), std::cos(x[2])), nb(-std::sin(x[3]), std::cos(x[3]));
  const Vector2 ta(std::cos(x[2]), std::sin(x[2])), tb(std::cos(x[3]), std::sin(x[3]));
  const double is = 1 / x[4], c = x[5];
  for (const Pixel& p : pixels) {
    const Vector2 q(p.x - x[0], p.y - x[1]);
    const double za = na.dot(q) * is, zb = nb.dot(q) * is;
    const double ea = 2 * kNormal.cumulative(za) - 1, eb = 2 * kNormal.cumulative(zb) - 1;
    const double fa = 2 * c * kNormal.density(za) * eb, fb = 2 * c * kNormal.density(zb) * ea;
    Eigen::Matrix<double, kParameters + 1, 1> j;
    j << -(fa * na.x() + fb * nb.x()) * is, -(fa * na.y() + fb * nb.y()) * is, -fa * ta.dot(q) * is,
        -fb * tb.dot(q) * is, -(fa * za + fb * zb) * is, ea * eb, 1, p.x, p.y,
        p.grey - (x[6] + x[7] * p.x + x[8] * p.y + c * ea * eb);
    sum.noalias() += j * j.transpose();
  }
  return sum;
}

/// The linear parameters (c, m, g) for given lines: where the iteration starts.
void solve_linear(const std::vector<Pixel>& pixels, Vector9* x) {
  const Matrix10 sum = accumulate(pixels, *x);
  x->tail<4>() += sum.block<4, 4>(5, 5).ldlt().solve(sum.block<4, 1>(5, kParameters));
}

/// Levenberg and Marquardt from x on; false where it does not settle.
bool descend(const std::vector<Pixel>& pixels, double radius_px, Vector9* x, Matrix10* at_end) {
  double damping = 1e-3;
  Matrix10 sum = accumulate(pixels, *x);
  for (int i = 0; i < kIterations; ++i) {
    Matrix9 n = sum.topLeftCorner<kParameters, kParameters>();
    n.diagonal() *= 1 + damping;
    n.diagonal().array() += 1e-9;
    const Vector9 step = n.ldlt().solve(sum.topRightCorner<kParameters, 1>());
    if (!step.allFinite()) return false;
    Vector9 next = *x + step;
    next[4] = std::clamp(next[4], 0.2, 0.7 * radius_px);
    if (next.head<2>().norm() > 0.5 * radius_px || std::abs(step[2]) > 1 || std::abs(step[3]) > 1) {
      damping *= 10;
      if (damping > 1e6) return false;
      continue;
    }
    const Matrix10 there = accumulate(pixels, next);
    const double before = sum(kParameters, kParameters), after = there(kParameters, kParameters);
    if (after > before * (1 + 1e-12)) {
      damping *= 10;
      if (damping > 1e8) break;
      continue;
    }
    *x = next;
    sum = there;
    damping = std::max(damping * 0.1, 1e-9);
    if (step.head<2>().norm() < 1e-5 && before - after < 1e-8 * before) break;
  }
  *at_end = sum;
  return true;
}

/// Both quadrants of one colour are brighter than both of the other, by a good part of the contrast: a corner
/// with one dark quadrant (the outer corner of a board) is no saddle, though a slope of light can make it fit
/// one.
bool four_quadrants(const Image8& image, const Vector2& centre, const Vector9& x, double radius_px) {
  const Vector2 a(std::cos(x[2]), std::sin(x[2])), b(std::cos(x[3]), std::sin(x[3]));
  const Vector2 along = 0.6 * radius_px * (a + b).normalized(),
                across = 0.6 * radius_px * (a - b).normalized();
  const double p = sample(image, centre + along), q = sample(image, centre - along);
  const double r = sample(image, centre + across), s = sample(image, centre - across);
  const double between = std::max(std::min(p, q) - std::max(r, s), std::min(r, s) - std::max(p, q));
  return between > 0.4 * 2 * std::abs(x[5]);
}

}  // namespace

std::optional<Saddle> fit_saddle(const Image8& image, const Eigen::Vector2d& start_px,
                                 const Eigen::Vector2d& along_a, const Eigen::Vector2d& along_b,
                                 double radius_px) {
  if (radius_px < kLeastRadiusPx || !start_px.allFinite()) return std::nullopt;
  Vector2 centre = start_px;
  Vector9 x;
  x << 0, 0, std::atan2(along_a.y(), along_a.x()), std::atan2(along_b.y(), along_b.x()), 0.3 * radius_px, 0,
      0, 0, 0;
  x[4] = std::clamp(x[4], 0.6, 1.5);
  Matrix10 sum;
  std::vector<Pixel> pixels;
  // The second round takes the disc about what the first has found.
  for (int round = 0; round < 2; ++round) {
    pixels = disc(image, centre, radius_px);
    if (pixels.size() < 2 * kParameters) return std::nullopt;
    solve_linear(pixels, &x);
    if (!descend(pixels, radius_px, &x, &sum)) return std::nullopt;
    if (round == 0) {
      centre += x.head<2>();
      x.head<2>().setZero();
    }
  }
  const double count = static_cast<double>(pixels.size());
  double mean = 0, variance = 0;
  for (const Pixel& p : pixels) mean += p.grey / count;
  for (const Pixel& p : pixels) variance += (p.grey - mean) * (p.grey - mean);
  const double residual = sum(kParameters, kParameters);
  const double between = std::abs(std::sin(x[2] - x[3]));
  if (2 * std::abs(x[5]) < kLeastContrastGrey || residual > kMostUnexplained * variance || between < 0.25 ||
      x[4] > 0.65 * radius_px || !inside(image, centre + x.head<2>(), radius_px) ||
      !four_quadrants(image, centre + x.head<2>(), x, 0.9 * radius_px))
    return std::nullopt;
  const double noise2 = std::max(residual / (count - kParameters), kQuantisationGrey2);
  const Matrix9 inverse = sum.topLeftCorner<kParameters, kParameters>().ldlt().solve(Matrix9::Identity());
  Saddle s;
  s.px = centre + x.head<2>();
  s.covariance_px2 =
      noise2 * inverse.topLeftCorner<2, 2>() + kFloorPx * kFloorPx * Eigen::Matrix2d::Identity();
  if (!s.covariance_px2.allFinite() || !(s.covariance_px2.determinant() > 0)) return std::nullopt;
  // Between +a and +b the two distances have opposite signs, whichever way the lines turn.
  s.contrast_grey = -2 * x[5];
  s.blur_px = x[4];
  s.noise_grey = std::sqrt(noise2);
  return s;
}

}  // namespace gnathion
