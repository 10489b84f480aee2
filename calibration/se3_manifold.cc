#include "calibration/se3_manifold.h"

namespace gnathion {
namespace {

using PlusMatrix = Eigen::Matrix<double, 7, 6, Eigen::RowMajor>;
using MinusMatrix = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

}  // namespace

PoseParameters pose_parameters(const Rigid3& pose) {
  PoseParameters x;
  x << Eigen::Quaterniond(pose.rotation).normalized().coeffs(), pose.translation_mm;
  return x;
}

Rigid3 rigid_from_parameters(const double* parameters) {
  const Eigen::Map<const PoseParameters> x(parameters);
  const Eigen::Quaterniond q(Eigen::Vector4d(x.head<4>()));
  return {q.normalized().toRotationMatrix(), x.tail<3>()};
}

bool Se3Manifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Vector6 xi = Eigen::Map<const Vector6>(delta);
  const Rigid3 moved = exp_se3(xi) * rigid_from_parameters(x);
  Eigen::Map<PoseParameters> out(x_plus_delta);
  out = pose_parameters(moved);
  // The quaternion's sign follows x, so that the parameters change continuously.
  if (out.head<4>().dot(Eigen::Map<const PoseParameters>(x).head<4>()) < 0.0) out.head<4>() *= -1.0;
  return true;
}

bool Se3Manifold::PlusJacobian(const double* x, double* jacobian) const {
  const Eigen::Map<const PoseParameters> p(x);
  const Vector3 v = p.head<3>();
  const double w = p[3];
  const Vector3 t = p.tail<3>();
  Eigen::Map<PlusMatrix> j(jacobian);
  j.setZero();
  // exp(ω) is the quaternion (ω/2, 1) to first order; (ω/2, 1)⊗(v, w) = (v + w·ω/2 + ω/2×v, w − ω·v/2).
  j.block<3, 3>(0, 0) = 0.5 * (w * Matrix3::Identity() - skew(v));
  j.block<1, 3>(3, 0) = -0.5 * v.transpose();
  j.block<3, 3>(4, 0) = -skew(t);
  j.block<3, 3>(4, 3) = Matrix3::Identity();
  return true;
}

bool Se3Manifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector6> out(y_minus_x);
  out = difference(rigid_from_parameters(y), rigid_from_parameters(x));
  return true;
}

bool Se3Manifold::MinusJacobian(const double* x, double* jacobian) const {
  const Eigen::Map<const PoseParameters> p(x);
  const Vector3 v = p.head<3>();
  const double w = p[3];
  const Vector3 t = p.tail<3>();
  Eigen::Map<MinusMatrix> j(jacobian);
  j.setZero();
  // ω = 2·vec(δq⊗q⁻¹) for a change δq of the quaternion; v follows from δt = ω×t + v.
  const Eigen::Matrix<double, 3, 3> by_vector = 2.0 * (w * Matrix3::Identity() + skew(v));
  j.block<3, 3>(0, 0) = by_vector;
  j.block<3, 1>(0, 3) = -2.0 * v;
  j.block<3, 3>(3, 0) = skew(t) * by_vector;
  j.block<3, 1>(3, 3) = -2.0 * skew(t) * v;
  j.block<3, 3>(3, 4) = Matrix3::Identity();
  return true;
}

}  // namespace gnathion
