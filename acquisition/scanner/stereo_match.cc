#include "acquisition/scanner/stereo_match.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <tuple>

namespace gnathion {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
/// Cubic resampling lowers the noise of a pixel (and hands it to its neighbours, where it counts as before):
/// the residual's variance is this share of what acts at the wavelengths that carry the texture. Mean over
/// sub-pixel phases of the squared weights, 0.73 an axis for OpenCV's kernel (a = −0.75); the first image is
/// resampled in two axes, the second in two and once more along the row (0.77 for a = −0.5).
constexpr double kResampledShare = 0.5 * (0.73 * 0.73 + 0.73 * 0.73 * 0.77);

/// What noise does not explain: resampling, and surface that curves within the window. Measured on rendered
/// faces without noise; enters the deviation.
constexpr double kModelSigma_px = 0.03;
constexpr double kFarthestTexture = 0.5;  // of the window's radius: centre of the texture from the pixel

cv::Mat as_bytes(const FloatImage& image) {
  const cv::Mat grey(image.height_px, image.width_px, CV_32F, const_cast<float*>(image.pixels.data()));
  cv::Mat bytes;
  grey.convertTo(bytes, CV_8U);
  return bytes;
}

/// Coefficients of the cubic B-spline through each row (Unser, Aldroubi & Eden 1993): between pixels it
/// follows fine texture much closer than a local cubic does, which would pull disparities towards whole
/// pixels.
FloatImage row_splines(const FloatImage& image) {
  FloatImage out = image;
  const double pole = std::sqrt(3.0) - 2;
  const int width = image.width_px;
  std::vector<double> c(static_cast<std::size_t>(width));
  for (int y = 0; y < image.height_px; ++y) {
    const float* row = image.pixels.data() + image.at(0, y);
    // Rows go on as they end: a constant's response.
    c[0] = 6 * static_cast<double>(row[0]) / (1 - pole);
    for (std::size_t x = 1; x < c.size(); ++x) c[x] = 6 * static_cast<double>(row[x]) + pole * c[x - 1];
    c.back() *= -pole / (1 - pole);
    for (std::size_t x = c.size() - 1; x-- > 0;) c[x] = pole * (c[x + 1] - c[x]);
    for (std::size_t x = 0; x < c.size(); ++x)
      out.pixels[out.at(static_cast<int>(x), y)] = static_cast<float>(c[x]);
  }
  return out;
}

/// The spline between its knots: value and slope.
struct Sample1 {
  double value, slope;
};
Sample1 sample_row(const float* row, double x) {
  const int i = static_cast<int>(std::floor(x));
  const double t = x - i, s = 1 - t;
  const double a = static_cast<double>(row[i - 1]), b = static_cast<double>(row[i]),
               c = static_cast<double>(row[i + 1]), d = static_cast<double>(row[i + 2]);
  return {(a * s * s * s + b * (4 - 6 * t * t + 3 * t * t * t) + c * (4 - 6 * s * s + 3 * s * s * s) +
           d * t * t * t) /
              6,
          (-a * s * s + b * (3 * t * t - 4 * t) + c * (4 * s - 3 * s * s) + d * t * t) / 2};
}

/// Disparity around a pixel: d + a·i + c·j.
struct Plane {
  double d = 0, a = 0, c = 0;
};

class Refiner {
 public:
  Refiner(const FloatImage& first, const FloatImage& second, const DisparityImage& coarse,
          const StereoOptions& options)
      : first_(first), second_(second), coarse_(coarse), options_(options), r_(options.refine_radius_px) {
    const double sigma = 0.5 * r_;
    for (int j = -r_; j <= r_; ++j)
      for (int i = -r_; i <= r_; ++i) weights_.push_back(std::exp(-(i * i + j * j) / (2 * sigma * sigma)));
  }

  /// Disparity and sigma at a pixel, or NaN.
  std::pair<float, float> at(int x, int y) const {
    const std::pair<float, float> none = {kNone, kNone};
    if (x < r_ || y < r_ || x >= first_.width_px - r_ || y >= first_.height_px - r_) return none;
    auto plane = start(x, y);
    if (!plane) return none;
    const double began = plane->d;
    double sigma = 0;
    for (int round = 0; round < 5; ++round) {
      const auto step = improve(x, y, *plane, &sigma);
      if (!step) return none;
      if (std::abs(plane->d - began) > 1.5 || std::abs(plane->a) > 1.5 || std::abs(plane->c) > 1.5)
        return none;
      if (std::abs(*step) < 0.003 && round > 0) break;
    }
    if (!(sigma <= options_.max_disparity_sigma_px)) return none;
    return {static_cast<float>(plane->d), static_cast<float>(sigma)};
  }

 private:
  /// Plane through the coarse disparities of the window that belong to the pixel's surface.
  std::optional<Plane> start(int x, int y) const {
    const float centre = coarse_.disparity_px[first_.at(x, y)];
    if (std::isnan(centre)) return std::nullopt;
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    int count = 0;
    for (int j = -r_; j <= r_; ++j)
      for (int i = -r_; i <= r_; ++i) {
        const float d = coarse_.disparity_px[first_.at(x + i, y + j)];
        if (!(std::abs(d - centre) <= 1.0f + 0.6f * static_cast<float>(std::max(std::abs(i), std::abs(j)))))
          continue;
        const Eigen::Vector3d row(1, i, j);
        h += row * row.transpose();
        g += static_cast<double>(d) * row;
        ++count;
      }
    // At a rim half a window is there; with less the plane is guesswork.
    if (count < (2 * r_ + 1) * (2 * r_ + 1) * 2 / 5) return std::nullopt;
    const Eigen::Vector3d p = h.ldlt().solve(g);
    return Plane{p[0], p[1], p[2]};
  }

  /// One Gauss-Newton step in (d, a, c, gain, offset); its length in d. Sigma of d by the sandwich of
  /// weights.
  std::optional<double> improve(int x, int y, Plane& plane, double* sigma) const {
    Eigen::Matrix<double, 5, 5> h = Eigen::Matrix<double, 5, 5>::Zero(), meat = h;
    Eigen::Matrix<double, 5, 1> g = Eigen::Matrix<double, 5, 1>::Zero();
    double sum_w = 0, sum_w2 = 0, sum_1 = 0, sum_11 = 0, energy = 0;
    Eigen::Vector2d lever = Eigen::Vector2d::Zero();
    std::size_t k = 0;
    for (int j = -r_; j <= r_; ++j) {
      const std::size_t row_at = static_cast<std::size_t>(y + j) * static_cast<std::size_t>(second_.width_px);
      const float* row2 = second_.pixels.data() + row_at;
      for (int i = -r_; i <= r_; ++i, ++k) {
        const double x2 = x + i - (plane.d + plane.a * i + plane.c * j);
        if (!(x2 >= 1 && x2 < second_.width_px - 3)) return std::nullopt;
        const std::size_t at1 = first_.at(x + i, y + j);
        if (!first_.seen[at1] || !second_.seen[row_at + static_cast<std::size_t>(x2)]) return std::nullopt;
        const Sample1 s = sample_row(row2, x2);
        const double i1 = static_cast<double>(first_.pixels[at1]);
        Eigen::Matrix<double, 5, 1> row;
        row << -s.slope, -s.slope * i, -s.slope * j, s.value, 1.0;
        const double w = weights_[k];
        h.noalias() += w * row * row.transpose();
        meat.noalias() += w * w * row * row.transpose();
        g += w * i1 * row;
        sum_w += w;
        sum_w2 += w * w;
        sum_1 += w * i1;
        sum_11 += w * i1 * i1;
        energy += w * s.slope * s.slope;
        lever += w * s.slope * s.slope * Eigen::Vector2d(i, j);
      }
    }
    // All texture on one side (a face's rim before an even wall): the match is the rim's, not this pixel's.
    if (!(lever.norm() <= kFarthestTexture * r_ * energy)) return std::nullopt;
    // Gain and offset enter linearly: solved for outright, with the geometry's steps beside them.
    const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> ldlt(h);
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return std::nullopt;
    const Eigen::Matrix<double, 5, 1> solution = ldlt.solve(g);
    const double gain = solution[3];
    if (!(gain > 0.3 && gain < 3)) return std::nullopt;
    const double variance_1 = sum_11 / sum_w - (sum_1 / sum_w) * (sum_1 / sum_w);
    const double residual = std::max(0.0, sum_11 - solution.dot(g)) / sum_w;
    if (!(residual <= (1 - options_.min_correlation * options_.min_correlation) * variance_1))
      return std::nullopt;
    const double step = solution[0] / gain;
    plane.d += step;
    plane.a += solution[1] / gain;
    plane.c += solution[2] / gain;
    const double effective = sum_w * sum_w / sum_w2;
    const double noise = residual * effective / std::max(1.0, effective - 5) / kResampledShare;
    const Eigen::Matrix<double, 5, 5> bread = ldlt.solve(Eigen::Matrix<double, 5, 5>::Identity());
    const double variance = noise * (bread * meat * bread)(0, 0) / (gain * gain);
    *sigma = std::sqrt(std::max(0.0, variance) + kModelSigma_px * kModelSigma_px);
    return step;
  }

  const FloatImage &first_, &second_;
  const DisparityImage& coarse_;
  const StereoOptions& options_;
  const int r_;
  std::vector<double> weights_;
};

}  // namespace

DisparityImage match_semi_globally(const FloatImage& first, const FloatImage& second, const Rectification& r,
                                   const StereoOptions& options, int* disparities) {
  const double half = 0.5 * r.focal_px * r.baseline_mm * (1 / options.near_mm - 1 / options.far_mm);
  const int least = -static_cast<int>(std::ceil(half)) - 1;
  const int count = (2 * static_cast<int>(std::ceil(half)) + 3 + 15) / 16 * 16;
  *disparities = count;
  const int block = options.match_block_px;
  const auto sgm = cv::StereoSGBM::create(least, count, block, 8 * block * block, 32 * block * block,
                                          std::max(1, static_cast<int>(std::lround(options.left_right_px))),
                                          31, 8, 0, 0, cv::StereoSGBM::MODE_SGBM);
  // SGBM gives nothing within `count` of the left border: room is made there, and taken away again.
  const int room = count + std::max(0, least);
  cv::Mat wide1, wide2, found;
  cv::copyMakeBorder(as_bytes(first), wide1, 0, 0, room, room, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(as_bytes(second), wide2, 0, 0, room, room, cv::BORDER_REPLICATE);
  sgm->compute(wide1, wide2, found);
  cv::filterSpeckles(found, (least - 1) * 16, options.speckle_px, 2 * 16);

  DisparityImage out;
  out.width_px = first.width_px;
  out.height_px = first.height_px;
  out.disparity_px.assign(first.pixels.size(), kNone);
  for (int y = 0; y < first.height_px; ++y)
    for (int x = 0; x < first.width_px; ++x) {
      const short d = found.at<short>(y, x + room);
      if (d < least * 16) continue;
      const float disparity = static_cast<float>(d) / 16.0f;
      const int x2 = static_cast<int>(std::lround(static_cast<float>(x) - disparity));
      const bool both =
          first.seen[first.at(x, y)] && x2 >= 0 && x2 < second.width_px && second.seen[second.at(x2, y)];
      if (both) out.disparity_px[first.at(x, y)] = disparity;
    }
  return out;
}

DisparityImage refined(const FloatImage& first, const FloatImage& second, const DisparityImage& coarse,
                       const StereoOptions& options) {
  const int step = options.step_px;
  DisparityImage out;
  out.width_px = (first.width_px + step - 1) / step;
  out.height_px = (first.height_px + step - 1) / step;
  const std::size_t pixels = static_cast<std::size_t>(out.width_px) * static_cast<std::size_t>(out.height_px);
  out.disparity_px.assign(pixels, kNone);
  out.sigma_px.assign(pixels, kNone);
  const FloatImage splines = row_splines(second);
  const Refiner refiner(first, splines, coarse, options);
  // Each pixel stands for itself: the same result on any number of threads.
  cv::parallel_for_(cv::Range(0, out.height_px), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y)
      for (int x = 0; x < out.width_px; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(out.width_px) +
                              static_cast<std::size_t>(x);
        std::tie(out.disparity_px[i], out.sigma_px[i]) = refiner.at(x * step, y * step);
      }
  });
  return out;
}

void trim_rims(DisparityImage& image) {
  const std::vector<float> before = image.disparity_px;
  const auto seen = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < image.width_px && y < image.height_px &&
           !std::isnan(before[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width_px) +
                              static_cast<std::size_t>(x)]);
  };
  for (int y = 0; y < image.height_px; ++y)
    for (int x = 0; x < image.width_px; ++x) {
      int lost = 0;
      for (int k = 0; k < 9; ++k) lost += seen(x + k % 3 - 1, y + k / 3 - 1) ? 0 : 1;
      if (lost < 3) continue;  // a single hole is no rim
      const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width_px) +
                            static_cast<std::size_t>(x);
      image.disparity_px[i] = image.sigma_px[i] = kNone;
    }
}

namespace {

/// Vertical shift of the second image at one matched pixel, by Gauss-Newton in both directions.
std::optional<double> row_shift(const FloatImage& first, const FloatImage& splines, int x, int y,
                                double disparity) {
  constexpr int kRadius = 7, kFarthest = 3;
  const int margin = kRadius + kFarthest + 2;
  const double x2 = x - disparity;
  if (x < margin || y < margin || x >= first.width_px - margin || y >= first.height_px - margin)
    return std::nullopt;
  if (!(x2 >= margin + kFarthest && x2 < splines.width_px - margin - kFarthest)) return std::nullopt;
  const auto row = [&](int at) {
    return splines.pixels.data() + static_cast<std::size_t>(at) * static_cast<std::size_t>(splines.width_px);
  };
  double across = 0, down = 0;
  for (int round = 0; round < 6; ++round) {
    const int whole = static_cast<int>(std::floor(down));
    const double part = down - whole;
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (int j = -kRadius; j <= kRadius; ++j)
      for (int i = -kRadius; i <= kRadius; ++i) {
        const Sample1 a = sample_row(row(y + j + whole), x2 + i + across),
                      b = sample_row(row(y + j + whole + 1), x2 + i + across);
        const Eigen::Vector3d by((1 - part) * a.slope + part * b.slope, b.value - a.value, 1);
        h += by * by.transpose();
        g += by * (static_cast<double>(first.pixels[first.at(x + i, y + j)]) - (1 - part) * a.value -
                   part * b.value);
      }
    const Eigen::LDLT<Eigen::Matrix3d> ldlt(h);
    if (!ldlt.isPositive()) return std::nullopt;
    const Eigen::Vector3d step = ldlt.solve(g);
    across += step[0];
    down += step[1];
    if (!(std::abs(across) < kFarthest && std::abs(down) < kFarthest)) return std::nullopt;
  }
  return down;
}

}  // namespace

double median_row_shift_px(const FloatImage& first, const FloatImage& second, const DisparityImage& refined,
                           int step) {
  constexpr std::size_t kAbout = 1000;
  std::vector<std::size_t> matched;
  for (std::size_t i = 0; i < refined.disparity_px.size(); ++i)
    if (!std::isnan(refined.disparity_px[i])) matched.push_back(i);
  const FloatImage splines = row_splines(second);
  std::vector<double> shifts;
  const auto width = static_cast<std::size_t>(refined.width_px);
  for (std::size_t n = 0; n < matched.size(); n += matched.size() / kAbout + 1) {
    const std::size_t i = matched[n];
    const auto shift =
        row_shift(first, splines, static_cast<int>(i % width) * step, static_cast<int>(i / width) * step,
                  static_cast<double>(refined.disparity_px[i]));
    if (shift) shifts.push_back(*shift);
  }
  if (shifts.empty()) return 0;
  std::nth_element(shifts.begin(), shifts.begin() + static_cast<long>(shifts.size() / 2), shifts.end());
  return shifts[shifts.size() / 2];
}

}  // namespace gnathion
