#include "tracking/corner_refine_fit.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include <Eigen/Cholesky>

namespace gnathion {
namespace {

using Vector7 = Eigen::Matrix<double, kEdgeParameters, 1>;
using Matrix7 = Eigen::Matrix<double, kEdgeParameters, kEdgeParameters>;

constexpr int kMostIterations = 12;
constexpr double kRoundingVariance = 0.01;  // a side without any noise still has grey levels
constexpr int kSaturated = 252;             // brighter pixels tell nothing of where an edge lies

// ---- Four floats at a time (the vector extension that g++ and clang share) ----

using Four = float __attribute__((vector_size(16)));
using FourInts = int __attribute__((vector_size(16)));

Four load(const float* p) {
  Four v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

/// e^x for -87 < x <= 0, to 3e-7 of its value.
inline Four exp_negative(Four x) {
  const Four t = x * 1.44269504f;
  const FourInts whole = __builtin_convertvector(t - 0.5f, FourInts);  // rounds toward 0: to the nearest
  const Four f = t - __builtin_convertvector(whole, Four);
  // 2^f on ±½: Taylor's polynomial of e^(f·ln 2).
  Four p = 1.5403530e-4f + 0.0f * f;
  p = p * f + 1.3333558e-3f;
  p = p * f + 9.6181291e-3f;
  p = p * f + 5.5504109e-2f;
  p = p * f + 2.4022651e-1f;
  p = p * f + 6.9314718e-1f;
  p = p * f + 1.0f;
  const FourInts bits = (whole + 127) << 23;
  Four scale;
  std::memcpy(&scale, &bits, sizeof scale);
  return p * scale;
}

struct Normal {
  Four cumulative, density;
};

/// Φ and its derivative, to 1e-7 (Abramowitz & Stegun 7.1.26).
inline Normal normal(Four z) {
  const FourInts positive = z > 0.0f;
  Four a = positive ? z : -z;
  a = a < 6.0f ? a : 6.0f + 0.0f * a;
  const Four e = exp_negative(-0.5f * a * a);
  const Four t = 1.0f / (1.0f + 0.2316419f * a);  // 0.3275911 / √2
  const Four poly =
      t * (0.254829592f + t * (-0.284496736f + t * (1.421413741f + t * (-1.453152027f + t * 1.061405429f))));
  const Four upper = 0.5f * poly * e;
  return {positive ? 1.0f - upper : upper, 0.39894228f * e};
}

float sum(Four v) {
  return (v[0] + v[1]) + (v[2] + v[3]);
}

// ---- The strip ----

double reach_of(double blur_px) {
  return std::clamp(2.6 * blur_px + 0.6, 2.2, 7.0);
}

/// Pixels with −in(u) ≤ d ≤ out(u), away from the corners.
bool cut(const Image8& image, const Side& side, double reach_px, double blur_px, EdgeStrip* strip) {
  const double end_margin = std::min(1.0 + 2.0 * blur_px, 0.25 * side.length_px);
  const double v_limit = 0.5 - end_margin / side.length_px;
  const double reach = std::min(reach_px, std::max(side.out0, side.out1) + 4) + std::abs(side.sagitta_px);
  const Vector2 last = side.start + side.length_px * side.along;
  for (const Vector2& end : {side.start, last}) {
    if (!inside(image, end + reach * side.normal, 0) || !inside(image, end - reach * side.normal, 0))
      return false;
  }
  const bool by_column = std::abs(side.along.x()) >= std::abs(side.along.y());
  const int major = by_column ? 0 : 1, minor = 1 - major;
  const int from = static_cast<int>(std::ceil(std::min(side.start[major], last[major])));
  const int to = static_cast<int>(std::floor(std::max(side.start[major], last[major])));
  const double half = reach / std::abs(side.normal[minor]);
  const int lines = to - from + 1, most_across = static_cast<int>(2 * half) + 1;
  const int stride = 1 + lines * most_across / (EdgeStrip::kCapacity - 8);
  const double line_slope = side.along[minor] / side.along[major];
  const double du = side.along[minor] / side.length_px, dd = side.normal[minor];
  // Neither what lies beyond the white margin nor the second row of data cells may shine in.
  const auto outer = [&](double cell) {
    return std::min(reach_px, std::max({cell - 2.3 * blur_px, std::min(cell - 1.5 * blur_px, 1.6), 1.0}));
  };
  const auto inner = [&](double cell) {
    return std::min({reach_px, cell, std::max(2 * cell - 2.3 * blur_px, 1.0)});
  };
  const double outer0 = outer(side.out0), outer1 = outer(side.out1);
  const double inner0 = inner(side.in0), inner1 = inner(side.in1);
  const int step = by_column ? image.width_px : 1, line_step = by_column ? 1 : image.width_px;
  const int minor_end = by_column ? image.height_px : image.width_px;
  int n = 0;
  for (int i = from; i <= to; i += stride) {
    const double on_line = side.start[minor] + (i - side.start[major]) * line_slope;
    const int lo = std::max(0, static_cast<int>(std::ceil(on_line - half)));
    const int hi = std::min(minor_end - 1, static_cast<int>(std::floor(on_line + half)));
    Vector2 p;
    p[major] = i;
    p[minor] = lo;
    double u = side.along.dot(p - side.start) / side.length_px, flat = side.normal.dot(p - side.start);
    const std::uint8_t* pixel = image.pixels.data() + static_cast<std::ptrdiff_t>(i) * line_step +
                                static_cast<std::ptrdiff_t>(lo) * step;
    for (int j = lo; j <= hi && n < EdgeStrip::kCapacity - 4; ++j, u += du, flat += dd, pixel += step) {
      const double v = u - 0.5;
      if (std::abs(v) > v_limit || *pixel >= kSaturated) continue;
      const double d = flat - 4 * side.sagitta_px * u * (1 - u);
      if (d < -(inner0 + (inner1 - inner0) * u) || d > outer0 + (outer1 - outer0) * u) continue;
      const std::size_t k = static_cast<std::size_t>(n++);
      strip->grey[k] = static_cast<float>(*pixel);
      strip->v[k] = static_cast<float>(v);
      strip->distance[k] = static_cast<float>(d);
      strip->weight[k] = 1;
    }
  }
  strip->count = n;
  return n >= 4 * kEdgeParameters;
}

/// Fills the last group of four with pixels of no weight.
void pad(EdgeStrip* strip) {
  for (std::size_t k = static_cast<std::size_t>(strip->count); k % 4 != 0; ++k) {
    strip->grey[k] = strip->v[k] = strip->distance[k] = strip->weight[k] = 0;
    strip->cell_in[k] = 1000;
    strip->inner_white[k] = 0;
  }
}

/// What the data cells add to the strip's inner part, where they reach into it.
void add_inner_cells(const Side& side, const InnerRow& row, double reach_px, double blur_px,
                     EdgeStrip* strip) {
  strip->inner_cells = row.runs > 0 && std::min(side.in0, side.in1) - reach_px < 3.5 * blur_px;
  if (!strip->inner_cells) return;
  const double per_px = std::min(4.0, (EdgeStrip::kGridCapacity - 4) / side.length_px);
  const int grid = static_cast<int>(side.length_px * per_px) + 3;
  for (int g = 0; g < grid; ++g)
    strip->white_row[static_cast<std::size_t>(g)] = row.white(g / per_px, blur_px);
  const double per_u = side.length_px * per_px;
  for (std::size_t k = 0; k < static_cast<std::size_t>(strip->count); ++k) {
    const double u = static_cast<double>(strip->v[k]) + 0.5, where = u * per_u;
    const std::size_t g = static_cast<std::size_t>(where);
    const double f = where - static_cast<double>(g);
    strip->cell_in[k] = static_cast<float>(side.cell_in(u));
    strip->inner_white[k] = static_cast<float>(strip->white_row[g] * (1 - f) + strip->white_row[g + 1] * f);
  }
}

/// Black and contrast at the start, from the strip's inner and outer halves.
void start_levels(const EdgeStrip& strip, EdgeFit* fit) {
  double black = 0, white = 0;
  int blacks = 0, whites = 0;
  const float beyond = static_cast<float>(std::min(1.8 * fit->x[2], 0.6 * fit->reach_px));
  for (std::size_t k = 0; k < static_cast<std::size_t>(strip.count); ++k) {
    if (strip.distance[k] < -beyond) black += static_cast<double>(strip.grey[k]), ++blacks;
    if (strip.distance[k] > beyond) white += static_cast<double>(strip.grey[k]), ++whites;
  }
  fit->x[3] = blacks ? black / blacks : 0;
  fit->x[5] = (whites ? white / whites : 255) - fit->x[3];
}

// ---- One linearisation ----

constexpr std::size_t kColumns = 8;  // ∂/∂(a, b, σ, B, B', C, C'), residual
constexpr std::size_t kBlock = 16;   // groups of four that stay in the cache between the two loops

struct Block {
  Four column[kColumns][kBlock];
};

template <std::size_t A, std::size_t... B>
void add_products(const Block& block, std::size_t groups, Matrix8* sums, std::index_sequence<B...>) {
  Four total[] = {(static_cast<void>(B), Four{})...};
  for (std::size_t g = 0; g < groups; ++g) {
    const Four x = block.column[A][g];
    ((total[B] += x * block.column[A + B][g]), ...);
  }
  (((*sums)(A, A + B) += static_cast<double>(sum(total[B]))), ...);
}

template <std::size_t... A>
void add_all_products(const Block& block, std::size_t groups, Matrix8* sums, std::index_sequence<A...>) {
  (add_products<A>(block, groups, sums, std::make_index_sequence<kColumns - A>()), ...);
}

template <bool kInnerCells>
void fill(EdgeStrip& strip, const Vector7& x, std::size_t first, std::size_t groups, Block* block) {
  const float a = static_cast<float>(x[0]), b = static_cast<float>(x[1]);
  const float black = static_cast<float>(x[3]), black_slope = static_cast<float>(x[4]);
  const float contrast0 = static_cast<float>(x[5]), contrast_slope = static_cast<float>(x[6]);
  const float inverse = static_cast<float>(1 / x[2]);
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t k = 4 * (first + g);
    const Four v = load(&strip.v[k]), d = load(&strip.distance[k]), w = load(&strip.weight[k]);
    const Four z = (d - a - b * v) * inverse;
    const Normal edge = normal(z);
    Four profile = edge.cumulative, slope = edge.density, spread = edge.density * z;
    if (kInnerCells) {
      const Four white = load(&strip.inner_white[k]);
      const Four zi = -z - load(&strip.cell_in[k]) * inverse;
      const Normal cell = normal(zi);
      profile += white * cell.cumulative;
      slope -= white * cell.density;
      spread += white * cell.density * zi;
    }
    const Four contrast = contrast0 + contrast_slope * v;
    const Four residual = load(&strip.grey[k]) - (black + black_slope * v + contrast * profile);
    std::memcpy(&strip.residual[k], &residual, sizeof residual);
    const Four scaled = -contrast * inverse * w, wp = w * profile;
    block->column[0][g] = scaled * slope;
    block->column[1][g] = scaled * slope * v;
    block->column[2][g] = scaled * spread;
    block->column[3][g] = w;
    block->column[4][g] = w * v;
    block->column[5][g] = wp;
    block->column[6][g] = wp * v;
    block->column[7][g] = w * residual;
  }
}

/// Σ (J r)ᵀ(J r) at `x`, upper triangle: the normal matrix, the gradient and the squared residuals at once.
Matrix8 accumulate(EdgeStrip& strip, const Vector7& x) {
  Matrix8 sums = Matrix8::Zero();
  Block block;
  const std::size_t all = (static_cast<std::size_t>(strip.count) + 3) / 4;
  for (std::size_t first = 0; first < all; first += kBlock) {
    const std::size_t groups = std::min(kBlock, all - first);
    if (strip.inner_cells) {
      fill<true>(strip, x, first, groups, &block);
    } else {
      fill<false>(strip, x, first, groups, &block);
    }
    add_all_products(block, groups, &sums, std::make_index_sequence<kColumns>());
  }
  return sums;
}

// ---- The fit ----

/// Variance of the grey values about the fit, without what the lens' true profile has over the model's: that
/// is odd in the distance from the edge (brighter here, darker there), moves no edge, and would pass for
/// noise.
double noise_variance(const EdgeStrip& strip, const EdgeFit& fit) {
  constexpr double kBinsPerPx = 4;
  constexpr std::size_t kBins = 32;
  std::array<double, kBins> odd{}, pixels{};
  double squares = 0, count = 0;
  const float a = static_cast<float>(fit.x[0]), b = static_cast<float>(fit.x[1]);
  for (std::size_t k = 0; k < static_cast<std::size_t>(strip.count); ++k) {
    if (strip.weight[k] == 0) continue;
    const double r = static_cast<double>(strip.residual[k]);
    const double d = static_cast<double>(strip.distance[k] - a - b * strip.v[k]);
    const std::size_t bin = std::min(static_cast<std::size_t>(std::abs(d) * kBinsPerPx), kBins - 1);
    odd[bin] += d > 0 ? r : -r;
    pixels[bin] += 1;
    squares += r * r;
    count += 1;
  }
  double freedom = count - kEdgeParameters;
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    if (pixels[bin] < 2) continue;
    squares -= odd[bin] * odd[bin] / pixels[bin];
    freedom -= 1;
  }
  return std::max(squares, 0.0) / std::max(freedom, 1.0);
}

/// Gauss–Newton from `fit` on; the set of pixels stays fixed.
bool iterate(EdgeStrip& strip, double blur_limit_px, int pixels, EdgeFit* fit) {
  for (int i = 0; i < kMostIterations; ++i) {
    const Matrix8 sums = accumulate(strip, fit->x);
    const Eigen::LLT<Matrix7, Eigen::Upper> solver(sums.topLeftCorner<7, 7>());
    if (solver.info() != Eigen::Success) return false;
    const Vector7 gradient = sums.topRightCorner<7, 1>(), full = solver.solve(gradient);
    if (!full.allFinite()) return false;
    Vector7 step = full;
    const double longest = std::max(std::abs(step[0]), 0.5 * std::abs(step[1]));
    if (longest > 1.0) step *= 1.0 / longest;
    step[2] = std::clamp(step[2], -0.4 * fit->x[2], 0.7 * fit->x[2]);
    const double blur_before = fit->x[2];
    fit->x += step;
    fit->x[2] = std::clamp(fit->x[2], 0.25, std::max(blur_limit_px, 0.6));
    // Gauss–Newton converges quadratically here: what is left after such a step is below 0.001 px.
    if (longest > 0.01 || std::abs(fit->x[2] - blur_before) > 0.03 * blur_before) continue;
    fit->noise_grey = std::sqrt(std::max(sums(7, 7) - full.dot(gradient), 0.0) / (pixels - kEdgeParameters));
    const double variance = noise_variance(strip, *fit) + kRoundingVariance;
    Eigen::Matrix<double, 7, 2> unit = Eigen::Matrix<double, 7, 2>::Identity();
    fit->covariance = variance * solver.solve(unit).topRows<2>();
    return true;
  }
  return false;
}

/// Takes the weight from segments of the side whose residuals are far beyond those of the others: something
/// lies over the edge there, or a highlight. Returns the pixels that are left, or 0 when nothing changed.
int uncover(EdgeStrip& strip, const EdgeFit& fit, int* covered) {
  std::array<double, kEdgeSegments> squares{}, pixels{};
  const auto segment_of = [](float v) {
    return static_cast<std::size_t>(
        std::clamp(static_cast<int>((v + 0.5f) * kEdgeSegments), 0, kEdgeSegments - 1));
  };
  const auto n = static_cast<std::size_t>(strip.count);
  for (std::size_t k = 0; k < n; ++k) {
    if (strip.weight[k] == 0) continue;
    const double r = static_cast<double>(strip.residual[k]);
    squares[segment_of(strip.v[k])] += r * r;
    pixels[segment_of(strip.v[k])] += 1;
  }
  std::array<double, kEdgeSegments> rms{}, sorted{};
  std::size_t judged = 0;
  for (std::size_t s = 0; s < kEdgeSegments; ++s) {
    const bool enough = pixels[s] >= 6;
    judged += enough;
    rms[s] = enough ? std::sqrt(squares[s] / pixels[s]) : 0;
    sorted[s] = enough ? rms[s] : 1e9;
  }
  if (judged < 4) return 0;
  for (std::size_t i = 1; i < kEdgeSegments; ++i) {
    for (std::size_t j = i; j > 0 && sorted[j] < sorted[j - 1]; --j) std::swap(sorted[j], sorted[j - 1]);
  }
  const double limit = std::max(2.5 * sorted[judged / 3], 0.03 * std::abs(fit.contrast_grey()));
  std::array<bool, kEdgeSegments> drop{};
  int dropped = 0;
  for (std::size_t s = 0; s < kEdgeSegments; ++s) dropped += drop[s] = rms[s] > limit;
  if (dropped == 0 || static_cast<std::size_t>(dropped) + 3 > judged) return 0;
  *covered += dropped;
  int left = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (drop[segment_of(strip.v[k])]) strip.weight[k] = 0;
    left += strip.weight[k] != 0;
  }
  return left;
}

}  // namespace

bool fit_edge(const Image8& image, const Side& side, const InnerRow& row, double start_blur_px,
              EdgeStrip* strip, EdgeFit* fit) {
  const double blur_limit = 0.8 * side.least_cell() + 0.4;
  const double blur = std::min(start_blur_px, blur_limit);
  *fit = EdgeFit{};
  fit->x[2] = blur;
  fit->reach_px = reach_of(blur);
  if (!cut(image, side, fit->reach_px, blur, strip)) return false;
  add_inner_cells(side, row, fit->reach_px, blur, strip);
  pad(strip);
  start_levels(*strip, fit);
  int pixels = strip->count;
  if (!iterate(*strip, blur_limit, pixels, fit)) return false;
  for (int round = 0; round < 3 && fit->noise_grey > 0.025 * std::abs(fit->contrast_grey()); ++round) {
    pixels = uncover(*strip, *fit, &fit->covered);
    if (pixels == 0) break;
    if (pixels < 4 * kEdgeParameters || !iterate(*strip, blur_limit, pixels, fit)) return false;
  }
  fit->fitted = true;
  return true;
}

}  // namespace gnathion
