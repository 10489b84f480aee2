#include "calibration/displacement.h"
#include "core/angle.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

struct Screw {
  Vector3 direction = Vector3::UnitX(), point_mm = Vector3::Zero();
  double angle_rad = 0.0, shift_mm = 0.0;
};

Screw screw_of(const Rigid3& motion, const Vector3& reference_mm) {
  Screw s;
  const Vector3 turn = log_so3(motion.rotation);
  s.angle_rad = turn.norm();
  const Vector3 moved = motion * reference_mm - reference_mm;
  if (s.angle_rad < 1e-9) {
    s.shift_mm = moved.norm();
    if (s.shift_mm > 0.0) s.direction = moved / s.shift_mm;
    s.point_mm = reference_mm;
    return s;
  }
  s.direction = turn / s.angle_rad;
  s.shift_mm = s.direction.dot(moved);
  // The axis' point c with (I − R)(c − reference) = what of the displacement is across the axis.
  const Vector3 across = moved - s.shift_mm * s.direction;
  s.point_mm = reference_mm + 0.5 * (across + s.direction.cross(across) / std::tan(0.5 * s.angle_rad));
  return s;
}

double worst_sigma(const Eigen::Matrix<double, 3, 6>& jacobian, const Matrix6& covariance) {
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(jacobian * covariance * jacobian.transpose(),
                                                      Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()[2]));
}

}  // namespace

double radius95_mm(const Matrix3& covariance_mm2) {
  const double mean = covariance_mm2.trace(), square = (covariance_mm2 * covariance_mm2).trace();
  if (!(mean > 0.0)) return 0.0;
  const double freedom = std::clamp(mean * mean / square, 1.0, 3.0);
  // 95 % quantiles of χ² with 1, 2 and 3 degrees of freedom, and a parabola between them.
  constexpr double k1 = 3.841458820694124, k2 = 5.991464547107979, k3 = 7.814727903251179;
  const double t = freedom - 1.0;
  const double quantile = k1 + t * (k2 - k1) + 0.5 * t * (t - 1.0) * (k3 - 2.0 * k2 + k1);
  return std::sqrt(mean / freedom * quantile);
}

std::vector<double> error_map95_mm(const Uncertain<Motion<Dental>>& therapeutic,
                                   const std::vector<Vector3>& points_mm) {
  std::vector<double> out;
  out.reserve(points_mm.size());
  for (const Vector3& p : points_mm)
    out.push_back(radius95_mm(point_covariance(therapeutic.covariance, therapeutic.value * p)));
  return out;
}

ScrewAxis screw_axis(const Uncertain<Motion<Dental>>& therapeutic, const Vector3& reference_mm) {
  const Rigid3& motion = therapeutic.value.rigid;
  const Screw s = screw_of(motion, reference_mm);
  ScrewAxis out;
  out.direction = s.direction;
  out.point_mm = s.point_mm;
  out.angle_deg = s.angle_rad * kDegPerRad;
  out.shift_mm = s.shift_mm;
  // Derivatives by small left perturbations, central differences.
  Eigen::Matrix<double, 3, 6> by_direction, by_point;
  Eigen::Matrix<double, 1, 6> by_angle, by_shift;
  for (int k = 0; k < 6; ++k) {
    const double h = k < 3 ? 1e-6 : 1e-4;
    const Vector6 step = h * Vector6::Unit(k);
    const Screw plus = screw_of(exp_se3(step) * motion, reference_mm),
                minus = screw_of(exp_se3(-step) * motion, reference_mm);
    by_direction.col(k) = (plus.direction - minus.direction) / (2.0 * h);
    by_point.col(k) = (plus.point_mm - minus.point_mm) / (2.0 * h);
    by_angle[k] = (plus.angle_rad - minus.angle_rad) / (2.0 * h);
    by_shift[k] = (plus.shift_mm - minus.shift_mm) / (2.0 * h);
  }
  // Along the axis its point is not defined; only what is across it counts.
  by_point = (Matrix3::Identity() - s.direction * s.direction.transpose()) * by_point;
  const Matrix6& c = therapeutic.covariance;
  out.angle_sigma_deg = std::sqrt(std::max(0.0, (by_angle * c * by_angle.transpose()).value())) * kDegPerRad;
  out.shift_sigma_mm = std::sqrt(std::max(0.0, (by_shift * c * by_shift.transpose()).value()));
  out.direction_sigma_deg = worst_sigma(by_direction, c) * kDegPerRad;
  out.point_sigma_mm = worst_sigma(by_point, c);
  out.determined = out.angle_deg > 1e-6 && out.angle_deg > 3.0 * out.angle_sigma_deg;
  return out;
}

}  // namespace gnathion
