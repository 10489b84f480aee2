#include "design/coarse_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "design/parallel.h"

namespace gnathion {
namespace {

std::array<double, 4> spline_weights(double t) {
  const double s = 1.0 - t;
  return {s * s * s / 6.0, (3 * t * t * t - 6 * t * t + 4) / 6.0, (3 * s * s * s - 6 * s * s + 4) / 6.0,
          t * t * t / 6.0};
}

/// Solves |grad d| = 1 at a node from the smallest neighbour on each axis (in units of the spacing).
double eikonal_update(double a, double b, double c) {
  if (a > b) std::swap(a, b);
  if (b > c) std::swap(b, c);
  if (a > b) std::swap(a, b);
  double d = a + 1.0;
  if (d <= b) return d;
  const double sum = a + b;
  const double root = 2.0 - (a - b) * (a - b);
  d = 0.5 * (sum + std::sqrt(std::max(0.0, root)));
  if (d <= c) return d;
  const double s = a + b + c;
  const double q = a * a + b * b + c * c;
  return (s + std::sqrt(std::max(0.0, s * s - 3.0 * (q - 1.0)))) / 3.0;
}

/// Distance in units of the spacing from a node to the level along each axis, where it is crossed; negative
/// where it is not. `node` points into the samples.
double distance_beside_level(const float* node, const std::array<std::ptrdiff_t, 3>& stride,
                             const std::array<bool, 3>& at_start, const std::array<bool, 3>& at_end) {
  const double here = *node;
  const bool in = here <= 0.0;
  double inverse_squares = 0.0;
  for (std::size_t d = 0; d < 3; ++d) {
    double nearest = 2.0;
    const auto look = [&](double there) {
      if (in != (there <= 0.0)) nearest = std::min(nearest, here / (here - there));
    };
    if (!at_start[d]) look(node[-stride[d]]);
    if (!at_end[d]) look(node[stride[d]]);
    if (nearest < 2.0) inverse_squares += 1.0 / std::max(1e-12, nearest * nearest);
  }
  return inverse_squares > 0.0 ? 1.0 / std::sqrt(inverse_squares) : -1.0;
}

}  // namespace

GridCell located(const GridShape& shape, const Vector3& p_mm) {
  const Vector3 u = (p_mm - shape.origin_mm) / shape.spacing_mm;
  GridCell cell;
  for (int d = 0; d < 3; ++d) {
    const double clamped = std::clamp(u[d], 0.0, static_cast<double>(shape.nodes[d] - 1));
    cell.index[d] = std::min(static_cast<int>(clamped), shape.nodes[d] - 2);
    cell.fraction[d] = clamped - cell.index[d];
  }
  return cell;
}

double CoarseGrid::linear(const GridCell& c) const {
  const std::size_t j = static_cast<std::size_t>(shape_.nodes.z());
  const std::size_t i = j * static_cast<std::size_t>(shape_.nodes.y());
  const float* v = &values_[shape_.index(c.index.x(), c.index.y(), c.index.z())];
  const double x = c.fraction.x(), y = c.fraction.y(), z = c.fraction.z();
  const auto along = [&](const float* p) { return (1.0 - z) * p[0] + z * p[1]; };
  return (1.0 - x) * ((1.0 - y) * along(v) + y * along(v + j)) +
         x * ((1.0 - y) * along(v + i) + y * along(v + i + j));
}

std::pair<float, float> CoarseGrid::range(const GridCell& c) const {
  const std::size_t j = static_cast<std::size_t>(shape_.nodes.z());
  const std::size_t i = j * static_cast<std::size_t>(shape_.nodes.y());
  const float* v = &values_[shape_.index(c.index.x(), c.index.y(), c.index.z())];
  return std::minmax({v[0], v[1], v[j], v[j + 1], v[i], v[i + 1], v[i + j], v[i + j + 1]});
}

double CoarseGrid::smooth(const Vector3& p_mm) const {
  return smooth(located(shape_, p_mm));
}

double CoarseGrid::smooth(const GridCell& c) const {
  const auto wx = spline_weights(c.fraction.x());
  const auto wy = spline_weights(c.fraction.y());
  const auto wz = spline_weights(c.fraction.z());
  const int first = c.index.z() - 1, last = shape_.nodes.z() - 1;
  const bool within = first >= 0 && first + 3 <= last;
  double sum = 0.0;
  for (std::size_t di = 0; di < 4; ++di) {
    const int i = std::clamp(c.index.x() + static_cast<int>(di) - 1, 0, shape_.nodes.x() - 1);
    for (std::size_t dj = 0; dj < 4; ++dj) {
      const int j = std::clamp(c.index.y() + static_cast<int>(dj) - 1, 0, shape_.nodes.y() - 1);
      const float* z = column(i, j);
      double along = 0.0;
      if (within) {
        for (std::size_t dk = 0; dk < 4; ++dk) along += wz[dk] * z[static_cast<std::size_t>(first) + dk];
      } else {
        for (std::size_t dk = 0; dk < 4; ++dk)
          along += wz[dk] * z[std::clamp(first + static_cast<int>(dk), 0, last)];
      }
      sum += wx[di] * wy[dj] * along;
    }
  }
  return sum;
}

CoarseGrid swept_up(const CoarseGrid& f, double slope) {
  CoarseGrid out = f;
  const float rise = static_cast<float>(slope * f.shape().spacing_mm);
  parallel_each(f.shape().nodes.x(), [&](int i) {
    for (int j = 0; j < f.shape().nodes.y(); ++j) {
      float* z = out.column(i, j);
      for (int k = 1; k < f.shape().nodes.z(); ++k) z[k] = std::min(z[k], z[k - 1] + rise);
    }
  });
  return out;
}

CoarseGrid swept_down(const CoarseGrid& f) {
  CoarseGrid out = f;
  parallel_each(f.shape().nodes.x(), [&](int i) {
    for (int j = 0; j < f.shape().nodes.y(); ++j) {
      float* z = out.column(i, j);
      for (int k = f.shape().nodes.z() - 2; k >= 0; --k) z[k] = std::min(z[k], z[k + 1]);
    }
  });
  return out;
}

GridShape sheared_box(GridShape shape, double sx, double sy) {
  const int top = shape.nodes.z() - 1;
  for (int d = 0; d < 2; ++d) {
    const double s = d == 0 ? sx : sy;
    const int more = static_cast<int>(std::ceil(top * std::abs(s)));
    shape.nodes[d] += more;
    if (s > 0.0) shape.origin_mm[d] -= more * shape.spacing_mm;
  }
  return shape;
}

CoarseGrid sheared(const CoarseGrid& f, double sx, double sy, const GridShape& shape) {
  CoarseGrid out(shape, 0.0f);
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k)
        out.at(i, j, k) = static_cast<float>(
            f.linear(Vector3(shape.position(i, j, k) + k * shape.spacing_mm * Vector3(sx, sy, 0.0))));
  });
  return out;
}

namespace {

/// First and last node of a column that a sweep can reach; none where last < first.
struct Span {
  std::int32_t first = std::numeric_limits<std::int32_t>::max(), last = -1;
  void join(const Span& other) {
    first = std::min(first, other.first);
    last = std::max(last, other.last);
  }
};

/// By column, the nodes within `reach` nodes of a fixed one, along each axis.
std::vector<Span> spans_about(const GridShape& shape, const std::vector<char>& fixed, int reach) {
  const int nx = shape.nodes.x(), ny = shape.nodes.y(), nz = shape.nodes.z();
  const auto at = [&](int i, int j) {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(ny) + j;
  };
  std::vector<Span> own(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny)), rows(own.size());
  parallel_each(nx, [&](int i) {
    for (int j = 0; j < ny; ++j) {
      const char* keep = &fixed[shape.index(i, j, 0)];
      const char* const first = std::find(keep, keep + nz, char{1});
      if (first == keep + nz) continue;
      int last = nz - 1;
      while (!keep[last]) --last;
      own[at(i, j)] = {static_cast<std::int32_t>(first - keep), last};
    }
    for (int j = 0; j < ny; ++j)
      for (int b = std::max(0, j - reach); b <= std::min(ny - 1, j + reach); ++b)
        rows[at(i, j)].join(own[at(i, b)]);
  });
  parallel_each(nx, [&](int i) {
    for (int j = 0; j < ny; ++j) {
      Span span;
      for (int a = std::max(0, i - reach); a <= std::min(nx - 1, i + reach); ++a) span.join(rows[at(a, j)]);
      if (span.last >= 0) span = {std::max(0, span.first - reach), std::min(nz - 1, span.last + reach)};
      own[at(i, j)] = span;
    }
  });
  return own;
}

}  // namespace

void sweep_distances(CoarseGrid& d, const std::vector<char>& fixed, double far_mm) {
  const auto n = d.shape().nodes;
  const auto far = static_cast<float>(far_mm);
  const double h = d.shape().spacing_mm;
  double nearest = far_mm;
  for (std::size_t i = 0; i < fixed.size(); ++i)
    if (fixed[i]) nearest = std::min(nearest, static_cast<double>(d.values()[i]));
  // Distances grow by at least one spacing a node along the axis that leads farthest away.
  const int reach = static_cast<int>(std::ceil((far_mm - nearest) / h)) + 1;
  const std::vector<Span> spans = spans_about(d.shape(), fixed, reach);
  // Eight sweeps, one per octant of directions; one round is exact but at kinks, where a second one adds
  // little.
  for (int octant = 0; octant < 8; ++octant) {
    const int sx = octant & 1, sy = (octant >> 1) & 1, sz = (octant >> 2) & 1;
    for (int a = 0; a < n.x(); ++a)
      for (int b = 0; b < n.y(); ++b) {
        const int i = sx ? n.x() - 1 - a : a, j = sy ? n.y() - 1 - b : b;
        const Span span = spans[static_cast<std::size_t>(i) * static_cast<std::size_t>(n.y()) + j];
        float* here = d.column(i, j);
        // Beyond the box's ends the column stands for its own neighbour: no node is nearer than itself.
        const float* before_x = d.column(std::max(i - 1, 0), j);
        const float* after_x = d.column(std::min(i + 1, n.x() - 1), j);
        const float* before_y = d.column(i, std::max(j - 1, 0));
        const float* after_y = d.column(i, std::min(j + 1, n.y() - 1));
        const char* keep = &fixed[d.shape().index(i, j, 0)];
        const int step = sz ? -1 : 1;
        for (int k = sz ? span.last : span.first; k >= span.first && k <= span.last; k += step) {
          if (keep[k]) continue;
          const float x = std::min(before_x[k], after_x[k]), y = std::min(before_y[k], after_y[k]);
          const float z = std::min(k > 0 ? here[k - 1] : far, k + 1 < n.z() ? here[k + 1] : far);
          const float least = std::min({x, y, z});
          if (least >= far || least >= here[k]) continue;
          here[k] = std::min(here[k], static_cast<float>(h * eikonal_update(x / h, y / h, z / h)));
        }
      }
  }
}

CoarseGrid redistanced(const CoarseGrid& f, double band_mm) {
  const GridShape& shape = f.shape();
  const Eigen::Vector3i n = shape.nodes;
  CoarseGrid d(shape, static_cast<float>(band_mm));
  std::vector<char> fixed(shape.size(), 0);
  const std::array<std::ptrdiff_t, 3> stride = {static_cast<std::ptrdiff_t>(n.y()) * n.z(), n.z(), 1};
  parallel_each(n.x(), [&](int i) {
    for (int j = 0; j < n.y(); ++j) {
      const float* column = f.column(i, j);
      for (int k = 0; k < n.z(); ++k) {
        const double beside = distance_beside_level(column + k, stride, {i == 0, j == 0, k == 0},
                                                    {i + 1 == n.x(), j + 1 == n.y(), k + 1 == n.z()});
        if (beside < 0.0) continue;
        d.at(i, j, k) = static_cast<float>(beside * shape.spacing_mm);
        fixed[shape.index(i, j, k)] = 1;
      }
    }
  });
  sweep_distances(d, fixed, band_mm);
  for (std::size_t i = 0; i < d.values().size(); ++i)
    if (f.values()[i] <= 0.0f) d.values()[i] = -d.values()[i];
  return d;
}

namespace {
CoarseGrid shifted(CoarseGrid f, double by_mm) {
  for (float& v : f.values()) v += static_cast<float>(by_mm);
  return f;
}
}  // namespace

namespace {
/// One axis of a separable filter.
CoarseGrid filtered(const CoarseGrid& f, const std::vector<float>& weights, int axis) {
  const Eigen::Vector3i n = f.shape().nodes;
  const int reach = static_cast<int>(weights.size()) / 2;
  CoarseGrid out = f;
  parallel_each(n.x(), [&](int i) {
    for (int j = 0; j < n.y(); ++j)
      for (int k = 0; k < n.z(); ++k) {
        float sum = 0.0f;
        for (int w = -reach; w <= reach; ++w) {
          Eigen::Vector3i at(i, j, k);
          at[axis] = std::clamp(at[axis] + w, 0, n[axis] - 1);
          sum += weights[static_cast<std::size_t>(w + reach)] * f.at(at.x(), at.y(), at.z());
        }
        out.at(i, j, k) = sum;
      }
  });
  return out;
}
}  // namespace

CoarseGrid blurred(const CoarseGrid& f, double sigma_mm) {
  const double sigma = sigma_mm / f.shape().spacing_mm;
  const int reach = static_cast<int>(std::ceil(3.0 * sigma));
  std::vector<float> weights;
  double sum = 0.0;
  for (int w = -reach; w <= reach; ++w) sum += std::exp(-0.5 * w * w / (sigma * sigma));
  for (int w = -reach; w <= reach; ++w)
    weights.push_back(static_cast<float>(std::exp(-0.5 * w * w / (sigma * sigma)) / sum));
  return filtered(filtered(filtered(f, weights, 0), weights, 1), weights, 2);
}

CoarseGrid closed(const CoarseGrid& f, double radius_mm) {
  const double band = radius_mm + 4.0 * f.shape().spacing_mm;
  const CoarseGrid dilated = shifted(redistanced(f, band), -radius_mm);
  return shifted(redistanced(dilated, band), radius_mm);
}

CoarseGrid opened(const CoarseGrid& f, double radius_mm) {
  const double band = radius_mm + 4.0 * f.shape().spacing_mm;
  const CoarseGrid eroded = shifted(redistanced(f, band), radius_mm);
  return shifted(redistanced(eroded, band), -radius_mm);
}

}  // namespace gnathion
