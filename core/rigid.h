// Rigid motions of space, untyped: the arithmetic under Transform<To, From> and Motion<F>.
//
// Column vectors, p' = R p + t, millimetres and radians. A tangent vector ξ = (ω, v) holds the
// rotation first, then the translation; perturbations act on the left: X = exp(ξ) X̂. A 6×6
// covariance is the covariance of that ξ. (Barfoot, State Estimation for Robotics, ch. 7, with the
// two halves exchanged.)
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace gnathion {

using Vector3 = Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix3 = Eigen::Matrix3d;
using Matrix4 = Eigen::Matrix4d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// A proper rigid motion, an element of SE(3).
struct Rigid3 {
  Matrix3 rotation = Matrix3::Identity();
  Vector3 translation_mm = Vector3::Zero();

  static Rigid3 identity() { return {}; }
  static Rigid3 from_translation(const Vector3& t_mm) { return {Matrix3::Identity(), t_mm}; }
  /// Rotation by `angle_rad` about the line through `point_mm` along `axis` (any length but 0).
  static Rigid3 about_axis(const Vector3& point_mm, const Vector3& axis, double angle_rad);
  /// The 4×4 matrix taken as it is; the caller has checked it (see nearest_rigid).
  static Rigid3 from_matrix(const Matrix4& m) { return {m.topLeftCorner<3, 3>(), m.topRightCorner<3, 1>()}; }

  Vector3 operator*(const Vector3& p_mm) const { return rotation * p_mm + translation_mm; }
  Rigid3 operator*(const Rigid3& b) const {
    return {rotation * b.rotation, rotation * b.translation_mm + translation_mm};
  }
  Rigid3 inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation_mm)}; }
  Matrix4 matrix() const;
  double angle_rad() const;  ///< rotation angle, 0..π
};

Matrix3 skew(const Vector3& w);
Matrix3 exp_so3(const Vector3& w_rad);
Vector3 log_so3(const Matrix3& rotation);  ///< exact near 0 and near π
Rigid3 exp_se3(const Vector6& xi);
Vector6 log_se3(const Rigid3& x);
/// Ad_X: X exp(ξ) X⁻¹ = exp(Ad_X ξ).
Matrix6 adjoint(const Rigid3& x);
/// X (−) Y: the ξ with X = exp(ξ) Y.
inline Vector6 difference(const Rigid3& x, const Rigid3& y) {
  return log_se3(x * y.inverse());
}

/// Covariance of a·b for independent a, b: Σ_a + Ad_a Σ_b Ad_aᵀ.
Matrix6 composed_covariance(const Matrix6& cov_a, const Rigid3& a, const Matrix6& cov_b);
/// Covariance of x⁻¹: Ad_{x⁻¹} Σ Ad_{x⁻¹}ᵀ.
Matrix6 inverse_covariance(const Matrix6& cov, const Rigid3& x);
/// 3×3 covariance (mm²) of the displaced point x·p when x has covariance `cov`; `xp_mm` = x·p.
Matrix3 point_covariance(const Matrix6& cov, const Vector3& xp_mm);

/// How far a 4×4 matrix is from a rigid motion.
struct RigidityDeviation {
  double determinant = 1.0;    ///< of the upper left 3×3; a rotation has 1
  double orthogonality = 0.0;  ///< largest |RᵀR − I| entry
  double last_row = 0.0;       ///< largest deviation from (0 0 0 1)
  bool finite = true;
  /// Accepts what rounding to 6 digits does, and no more.
  bool is_rigid(double tolerance = 1e-4) const;
};
RigidityDeviation rigidity_deviation(const Matrix4& m);
/// The closest rotation (polar decomposition) with m's translation. For m that is_rigid.
Rigid3 nearest_rigid(const Matrix4& m);

}  // namespace gnathion
