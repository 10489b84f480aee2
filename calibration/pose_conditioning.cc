#include "calibration/pose_conditioning.h"
#include "core/angle.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace gnathion {
namespace {

/// "the bow's long axis" where the direction is within 20° of one of the body's, else its components.
std::string axis_text(const Vector3& direction, const BodyAxes& body) {
  static const char* const kNames[] = {"long", "middle", "short"};
  const Vector3 along = body.axes.transpose() * direction;
  long most = 0;
  if (along.cwiseAbs().maxCoeff(&most) > 0.94) return fmt::format("{}'s {} axis", body.name, kNames[most]);
  Vector3 shown = direction;
  shown.cwiseAbs().maxCoeff(&most);
  if (shown[most] < 0.0) shown = -shown;
  return fmt::format("the axis ({:.2f} {:.2f} {:.2f}) through {}", shown.x(), shown.y(), shown.z(),
                     body.name);
}

}  // namespace

BodyAxes body_axes(std::string name, const TriangleMesh& surface) {
  BodyAxes body;
  body.name = std::move(name);
  body.centre_mm = surface_centroid_mm(surface);
  Matrix3 spread = Matrix3::Zero();
  double area = 0.0;
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    const double a = face_normal_scaled(surface, t).norm();
    const Vector3 p =
        (surface.corner(t, 0) + surface.corner(t, 1) + surface.corner(t, 2)) / 3.0 - body.centre_mm;
    spread += a * p * p.transpose();
    area += a;
  }
  spread /= std::max(area, std::numeric_limits<double>::min());
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(spread);
  body.axes = solver.eigenvectors().rowwise().reverse();
  body.radius_mm = std::max(1.0, std::sqrt(spread.trace()));
  return body;
}

BodyAxes moved(const Rigid3& to_from_body, BodyAxes body) {
  body.centre_mm = to_from_body * body.centre_mm;
  body.axes = to_from_body.rotation * body.axes;
  return body;
}

PoseConditioning pose_conditioning(const Matrix6& covariance, const BodyAxes& body) {
  constexpr double kWeak_mm = 0.1, kRelativelyWeak_mm = 0.02, kRatio = 7.0;
  Matrix6 about = adjoint(Rigid3::from_translation(-body.centre_mm));
  about.topRows<3>() *= body.radius_mm;  // angles as displacements at the radius
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(about * covariance * about.transpose());
  const Vector6 sigma_mm = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();  // the best first
  PoseConditioning result;
  result.condition = sigma_mm[0] > 0.0 ? sigma_mm[5] * sigma_mm[5] / (sigma_mm[0] * sigma_mm[0])
                                       : std::numeric_limits<double>::infinity();
  for (int k = 5; k >= 0; --k) {
    const bool relatively = sigma_mm[k] > kRatio * sigma_mm[0] && sigma_mm[k] > kRelativelyWeak_mm;
    if (!relatively && sigma_mm[k] < kWeak_mm) continue;
    const Vector6 d = solver.eigenvectors().col(k);
    const bool turning = d.head<3>().norm() > d.tail<3>().norm();
    result.weak.push_back(turning ? fmt::format("rotation about {} is weak: {:.3f} deg",
                                                axis_text(d.head<3>().normalized(), body),
                                                sigma_mm[k] / body.radius_mm * kDegPerRad)
                                  : fmt::format("translation along {} is weak: {:.3f} mm",
                                                axis_text(d.tail<3>().normalized(), body), sigma_mm[k]));
  }
  return result;
}

}  // namespace gnathion
