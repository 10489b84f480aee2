#include "core/rigid.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace gnathion {
namespace {

constexpr double kSmallAngleRad = 1e-5;

/// Left Jacobian of SO(3): exp_se3's translation is J(ω) v.
Matrix3 left_jacobian(const Vector3& w) {
  const double angle = w.norm();
  const Matrix3 wx = skew(w);
  if (angle < kSmallAngleRad) return Matrix3::Identity() + 0.5 * wx + wx * wx / 6.0;
  const double a2 = angle * angle;
  return Matrix3::Identity() + (1 - std::cos(angle)) / a2 * wx +
         (angle - std::sin(angle)) / (a2 * angle) * wx * wx;
}

}  // namespace

Rigid3 Rigid3::about_axis(const Vector3& point_mm, const Vector3& axis, double angle_rad) {
  const Matrix3 r = exp_so3(axis.normalized() * angle_rad);
  return {r, point_mm - r * point_mm};
}

Matrix4 Rigid3::matrix() const {
  Matrix4 m = Matrix4::Identity();
  m.topLeftCorner<3, 3>() = rotation;
  m.topRightCorner<3, 1>() = translation_mm;
  return m;
}

double Rigid3::angle_rad() const {
  return log_so3(rotation).norm();
}

Matrix3 skew(const Vector3& w) {
  Matrix3 m;
  m << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return m;
}

Matrix3 exp_so3(const Vector3& w) {
  const double angle = w.norm();
  const Matrix3 wx = skew(w);
  if (angle < kSmallAngleRad) return Matrix3::Identity() + wx + 0.5 * wx * wx;
  return Matrix3::Identity() + std::sin(angle) / angle * wx +
         (1 - std::cos(angle)) / (angle * angle) * wx * wx;
}

Vector3 log_so3(const Matrix3& rotation) {
  // The quaternion keeps full precision at both ends, 0 and π.
  Eigen::Quaterniond q(rotation);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine_half = q.vec().norm();
  if (sine_half < 1e-12) return 2.0 * q.vec();
  return q.vec() * (2.0 * std::atan2(sine_half, q.w()) / sine_half);
}

Rigid3 exp_se3(const Vector6& xi) {
  const Vector3 w = xi.head<3>();
  return {exp_so3(w), left_jacobian(w) * xi.tail<3>()};
}

Vector6 log_se3(const Rigid3& x) {
  Vector6 xi;
  xi.head<3>() = log_so3(x.rotation);
  xi.tail<3>() = left_jacobian(xi.head<3>()).partialPivLu().solve(x.translation_mm);
  return xi;
}

Matrix6 adjoint(const Rigid3& x) {
  Matrix6 ad = Matrix6::Zero();
  ad.topLeftCorner<3, 3>() = x.rotation;
  ad.bottomRightCorner<3, 3>() = x.rotation;
  ad.bottomLeftCorner<3, 3>() = skew(x.translation_mm) * x.rotation;
  return ad;
}

Matrix6 composed_covariance(const Matrix6& cov_a, const Rigid3& a, const Matrix6& cov_b) {
  const Matrix6 ad = adjoint(a);
  return cov_a + ad * cov_b * ad.transpose();
}

Matrix6 inverse_covariance(const Matrix6& cov, const Rigid3& x) {
  const Matrix6 ad = adjoint(x.inverse());
  return ad * cov * ad.transpose();
}

Matrix3 point_covariance(const Matrix6& cov, const Vector3& xp_mm) {
  Eigen::Matrix<double, 3, 6> j;
  j.leftCols<3>() = -skew(xp_mm);
  j.rightCols<3>() = Matrix3::Identity();
  return j * cov * j.transpose();
}

bool RigidityDeviation::is_rigid(double tolerance) const {
  return finite && std::abs(determinant - 1.0) <= 3 * tolerance && orthogonality <= tolerance &&
         last_row <= tolerance;
}

RigidityDeviation rigidity_deviation(const Matrix4& m) {
  RigidityDeviation d;
  d.finite = m.allFinite();
  const Matrix3 r = m.topLeftCorner<3, 3>();
  d.determinant = r.determinant();
  d.orthogonality = (r.transpose() * r - Matrix3::Identity()).cwiseAbs().maxCoeff();
  d.last_row = (m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff();
  return d;
}

Rigid3 nearest_rigid(const Matrix4& m) {
  const Matrix3 r = m.topLeftCorner<3, 3>();
  GNATHION_CHECK(r.determinant() > 0);
  const Eigen::JacobiSVD<Matrix3> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.matrixU() * svd.matrixV().transpose(), m.topRightCorner<3, 1>()};
}

}  // namespace gnathion
