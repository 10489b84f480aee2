#include "tracking/se3_mean.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "core/check.h"

namespace gnathion {
namespace {

/// Errors ξ_i of the poses about `mean`, and the robust distance of each.
void errors_about(const std::vector<Rigid3>& poses, const Rigid3& mean, double lever_mm,
                  std::vector<Vector6>* errors, std::vector<double>* distances) {
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Vector6 xi = difference(poses[i], mean);
    (*errors)[i] = xi;
    // Displacement of the moved frame's origin: left perturbations tell it at the fixed frame's.
    const Vector3 w = xi.head<3>(), shift = xi.tail<3>() + w.cross(mean.translation_mm);
    (*distances)[i] = std::sqrt(shift.squaredNorm() + lever_mm * lever_mm * w.squaredNorm());
  }
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// 1 up to 2.5 times the median distance, then Tukey's fall to 0 at 5 times.
double weight_of(double distance, double spread) {
  const double from = 2.5 * spread + 1e-9, to = 2 * from;
  if (distance <= from) return 1;
  if (distance >= to) return 0;
  const double q = (distance - from) / (to - from);
  return (1 - q * q) * (1 - q * q);
}

/// Integrated autocorrelation time in samples, pooled over the six components scaled to unit variance.
double correlation_time(const std::vector<Vector6>& errors, const std::vector<double>& weights,
                        const Matrix6& cov) {
  const std::size_t n = errors.size();
  Vector6 scale;
  for (int c = 0; c < 6; ++c) scale[c] = cov(c, c) > 0 ? 1 / std::sqrt(cov(c, c)) : 0;
  const double components = static_cast<double>((scale.array() > 0).count());
  if (components == 0) return 1;
  double time = 1;
  for (std::size_t lag = 1; lag < n / 2; ++lag) {
    double sum = 0, total = 0;
    for (std::size_t i = 0; i + lag < n; ++i) {
      const double w = weights[i] * weights[i + lag];
      sum += w * errors[i].cwiseProduct(scale).dot(errors[i + lag].cwiseProduct(scale));
      total += w;
    }
    if (total <= 0) break;
    const double rho = sum / (total * components) + 1.0 / static_cast<double>(n);  // its bias is −1/n
    if (rho < 0.05) break;
    time += 2 * (1 - static_cast<double>(lag) / static_cast<double>(n)) * rho;
  }
  return time;
}

}  // namespace

PoseMean robust_mean(const std::vector<Rigid3>& poses, double lever_mm) {
  GNATHION_CHECK(!poses.empty());
  const std::size_t n = poses.size();
  std::vector<Vector6> errors(n);
  std::vector<double> distances(n), weights(n, 1.0);
  PoseMean result;
  result.mean = poses[n / 2];
  double weight_sum = static_cast<double>(n);
  for (int i = 0; i < 50; ++i) {
    errors_about(poses, result.mean, lever_mm, &errors, &distances);
    const double spread = median(distances);
    Vector6 step = Vector6::Zero();
    weight_sum = 0;
    for (std::size_t k = 0; k < n; ++k) {
      weights[k] =
          i < 3 ? 1 / (1 + std::pow(distances[k] / (2 * spread + 1e-9), 2)) : weight_of(distances[k], spread);
      step += weights[k] * errors[k];
      weight_sum += weights[k];
    }
    step /= weight_sum;
    result.mean = exp_se3(step) * result.mean;
    if (i >= 4 && step.head<3>().norm() * lever_mm + step.tail<3>().norm() < 1e-10) break;
  }
  errors_about(poses, result.mean, lever_mm, &errors, &distances);
  double squares = 0;
  for (std::size_t k = 0; k < n; ++k) {
    result.sample_covariance += weights[k] * errors[k] * errors[k].transpose();
    squares += weights[k] * weights[k];
    result.used += weights[k] > 0.5;
  }
  const double count = weight_sum * weight_sum / squares;
  result.sample_covariance /= weight_sum * std::max(1 - 1 / count, 0.5);
  result.effective_count = std::max(1.0, count / correlation_time(errors, weights, result.sample_covariance));
  result.mean_covariance = result.sample_covariance / result.effective_count;
  return result;
}

}  // namespace gnathion
