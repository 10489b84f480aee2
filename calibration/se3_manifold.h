// SE(3) for Ceres: seven numbers (unit quaternion x y z w, translation in mm) with the left perturbation of
// core/rigid.h, x ⊞ ξ = exp(ξ)·x, so that Ceres' covariances are ours.
#pragma once

#include <ceres/manifold.h>

#include "core/rigid.h"

namespace gnathion {

using PoseParameters = Eigen::Matrix<double, 7, 1>;

PoseParameters pose_parameters(const Rigid3& pose);
Rigid3 rigid_from_parameters(const double* parameters);

class Se3Manifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

}  // namespace gnathion
