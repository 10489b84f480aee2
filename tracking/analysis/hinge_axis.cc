#include "tracking/analysis/hinge_axis.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace gnathion {
namespace {

using Matrix4d = Eigen::Matrix<double, 4, 4>;
using Vector4d = Eigen::Matrix<double, 4, 1>;

constexpr std::size_t kFewestRows = 8;
constexpr double kLeastTurn_rad = 4 * M_PI / 180, kHalfAxis_mm = 55;

struct Axis {
  Vector3 point_mm, direction;
};

/// Two unit vectors that make a frame with `a`.
std::pair<Vector3, Vector3> across(const Vector3& a) {
  const Vector3 u = a.unitOrthogonal();
  return {u, a.cross(u)};
}

/// The axis turned about u and v, and shifted along them.
Axis moved(const Axis& axis, const Vector4d& step) {
  const auto [u, v] = across(axis.direction);
  return {axis.point_mm + step[2] * u + step[3] * v,
          (exp_so3(step[0] * u + step[1] * v) * axis.direction).normalized()};
}

Rigid3 turned(const Axis& axis, double angle_rad) {
  return Rigid3::about_axis(axis.point_mm, axis.direction, angle_rad);
}

/// One row's part in the fit: whitened residual at its own best angle.
class Row {
 public:
  Row(const Rigid3& motion, const Matrix6& covariance) : motion_(motion), llt_(covariance) {}

  Vector6 residual(const Axis& axis, double angle_rad) const {
    return llt_.matrixL().solve(log_se3(motion_ * turned(axis, angle_rad).inverse()));
  }
  Vector6 by_angle(const Axis& axis, double angle_rad) const {
    constexpr double kStep = 1e-5;
    return (residual(axis, angle_rad + kStep) - residual(axis, angle_rad - kStep)) / (2 * kStep);
  }
  /// Moves the angle to where it fits best.
  void settle(const Axis& axis, double* angle_rad) const {
    for (int i = 0; i < 2; ++i) {
      const Vector6 j = by_angle(axis, *angle_rad);
      *angle_rad -= j.dot(residual(axis, *angle_rad)) / j.squaredNorm();
    }
  }
  /// Adds the normal equations of the axis, the angle eliminated; gives χ².
  double add(const Axis& axis, double angle_rad, Matrix4d* n, Vector4d* g) const {
    constexpr double kSteps[4] = {1e-5, 1e-5, 1e-3, 1e-3};
    const Vector6 r = residual(axis, angle_rad), w = by_angle(axis, angle_rad).normalized();
    Eigen::Matrix<double, 6, 4> j;
    for (int k = 0; k < 4; ++k) {
      Vector4d step = Vector4d::Zero();
      step[k] = kSteps[k];
      j.col(k) = (residual(moved(axis, step), angle_rad) - residual(moved(axis, -step), angle_rad)) /
                 (2 * kSteps[k]);
      j.col(k) -= w * w.dot(j.col(k));
    }
    *n += j.transpose() * j;
    *g += j.transpose() * r;
    return r.squaredNorm();
  }

 private:
  Rigid3 motion_;
  Eigen::LLT<Matrix6> llt_;
};

/// Linear start: the direction of the rotation vectors' sum, and the point that stays, (R − I)p = −t.
Axis start_of(const HingeArc& arc, const Vector3& plane_point_mm, const Vector3& left) {
  Vector3 sum = Vector3::Zero();
  Matrix3 n = Matrix3::Zero();
  Vector3 g = Vector3::Zero();
  for (const Rigid3& m : arc.motions) {
    const Vector3 w = log_so3(m.rotation);
    sum += w.dot(left) >= 0 ? w : Vector3(-w);
    const Matrix3 d = m.rotation - Matrix3::Identity();
    n += d.transpose() * d;
    g -= d.transpose() * m.translation_mm;
  }
  const Vector3 a = sum.normalized();
  n += n.trace() * a * a.transpose();
  g += n.trace() * 0.5 * a * a.dot(plane_point_mm);  // the trace has doubled
  return {n.ldlt().solve(g), a};
}

struct Fit {
  Axis axis;
  Matrix4d covariance = Matrix4d::Zero();
  double chi2 = 0;
};

std::optional<Fit> fit(const HingeArc& arc, const Vector3& plane_point_mm, const Vector3& left) {
  Fit f{start_of(arc, plane_point_mm, left)};
  std::vector<Row> rows;
  std::vector<double> angles;
  // A covariance may be singular (none is known): a micrometre and a microradian keep it regular.
  Matrix6 least = Matrix6::Zero();
  least.diagonal() << Vector3::Constant(1e-12), Vector3::Constant(1e-6);
  for (std::size_t i = 0; i < arc.motions.size(); ++i) {
    rows.emplace_back(arc.motions[i], arc.covariance[i] + least);
    angles.push_back(f.axis.direction.dot(log_so3(arc.motions[i].rotation)));
  }
  for (int iteration = 0; iteration < 12; ++iteration) {
    Matrix4d n = Matrix4d::Zero();
    Vector4d g = Vector4d::Zero();
    f.chi2 = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i].settle(f.axis, &angles[i]);
      f.chi2 += rows[i].add(f.axis, angles[i], &n, &g);
    }
    const Eigen::LDLT<Matrix4d> solver(n);
    if (solver.info() != Eigen::Success || !solver.isPositive()) return std::nullopt;
    const Vector4d step = -solver.solve(g);
    if (!step.allFinite() || step.tail<2>().norm() > 1000) return std::nullopt;
    f.axis = moved(f.axis, step);
    f.covariance = solver.solve(Matrix4d::Identity());
    if (step.head<2>().norm() < 1e-7 && step.tail<2>().norm() < 1e-5) break;
  }
  return f;
}

/// Where an axis meets the plane through `point_mm` normal to `normal`.
Vector3 met(const Axis& axis, const Vector3& point_mm, const Vector3& normal) {
  const double along = axis.direction.dot(normal);
  if (std::abs(along) < 0.1) return axis.point_mm;
  return axis.point_mm + axis.direction * (normal.dot(point_mm - axis.point_mm) / along);
}

/// Distance of two axes, the larger of the planes 55 mm to the left and right, with its standard deviation.
void tell_migration(const HingeArc& arc, const Vector3& plane_point_mm, const Vector3& left,
                    HingeAxis* hinge) {
  HingeArc halves[2];
  for (std::size_t i = 0; i < arc.motions.size(); ++i) {
    HingeArc& half = halves[arc.motions[i].angle_rad() > 0.5 * hinge->largest_deg * M_PI / 180];
    half.motions.push_back(arc.motions[i]);
    half.covariance.push_back(arc.covariance[i]);
  }
  if (std::min(halves[0].motions.size(), halves[1].motions.size()) < 4) return;
  const auto a = fit(halves[0], plane_point_mm, left), b = fit(halves[1], plane_point_mm, left);
  if (!a || !b) return;
  for (const double side : {-kHalfAxis_mm, kHalfAxis_mm}) {
    const Vector3 at = plane_point_mm + side * left;
    hinge->migration_mm =
        std::max(hinge->migration_mm, (met(a->axis, at, left) - met(b->axis, at, left)).norm());
  }
  double variance = 0;
  for (const Fit* f : {&*a, &*b})
    variance += f->covariance(2, 2) + f->covariance(3, 3) +
                kHalfAxis_mm * kHalfAxis_mm * (f->covariance(0, 0) + f->covariance(1, 1));
  hinge->migration_sigma_mm = std::sqrt(variance);
}

}  // namespace

std::optional<HingeAxis> fit_hinge_axis(const HingeArc& arc, const Vector3& plane_point_mm,
                                        const Vector3& left, bool with_migration) {
  double largest = 0;
  for (const Rigid3& m : arc.motions) largest = std::max(largest, m.angle_rad());
  if (arc.motions.size() < kFewestRows || largest < kLeastTurn_rad) return std::nullopt;
  const auto found = fit(arc, plane_point_mm, left);
  if (!found) return std::nullopt;
  HingeAxis hinge;
  hinge.direction = found->axis.direction;
  if (hinge.direction.dot(left) < 0) hinge.direction = -hinge.direction;
  hinge.point_mm = met(found->axis, plane_point_mm, left);
  hinge.rows = static_cast<int>(arc.motions.size());
  hinge.largest_deg = largest * 180 / M_PI;
  hinge.chi2_per_dof = found->chi2 / (5.0 * static_cast<double>(arc.motions.size()) - 4);
  double misfit = 0, expected = 0;
  for (std::size_t i = 0; i < arc.motions.size(); ++i)
    for (const double side : {-kHalfAxis_mm, kHalfAxis_mm}) {
      const Vector3 p = hinge.point_mm + side * hinge.direction;
      misfit += (arc.motions[i] * p - p).squaredNorm();
      expected += point_covariance(arc.covariance[i], p).trace();
    }
  const double count = 2.0 * static_cast<double>(arc.motions.size());
  hinge.misfit_mm = std::sqrt(misfit / count);
  hinge.expected_mm = std::sqrt(expected / count);
  if (with_migration) tell_migration(arc, plane_point_mm, left, &hinge);
  return hinge;
}

}  // namespace gnathion
