// What a motion of the mandible does, and how sure that is: at points, over a surface, as a screw.
#pragma once

#include <vector>

#include "core/mesh.h"
#include "core/transform.h"

namespace gnathion {

/// Radius of the ball about a point that holds 95 % of a normal error with this covariance (mm²). The squared
/// error is a sum of three scaled χ²; a χ² of the same mean and variance stands for it (Satterthwaite 1946),
/// which is off by less than 2 %.
double radius95_mm(const Matrix3& covariance_mm2);

/// For each point of the mandible in MI the radius that holds 95 % of the error of its place in TP.
std::vector<double> error_map95_mm(const Uncertain<Motion<Dental>>& therapeutic,
                                   const std::vector<Vector3>& points_mm);

/// A motion as a turn about an axis and a shift along it (Chasles).
struct ScrewAxis {
  Vector3 direction = Vector3::UnitX();  ///< unit; the turn is counter-clockwise about it
  Vector3 point_mm = Vector3::Zero();    ///< of the axis, nearest to the reference point
  double angle_deg = 0.0, shift_mm = 0.0;
  // 1σ, to first order.
  double angle_sigma_deg = 0.0, shift_sigma_mm = 0.0;
  double direction_sigma_deg = 0.0;  ///< in the worst direction
  double point_sigma_mm = 0.0;       ///< across the axis, in the worst direction
  /// False: the turn is less than three times its sigma, and so is no axis. Angle and shift still hold.
  bool determined = false;
};
/// `reference_mm`: where the axis' point is looked for (the arch's centroid).
ScrewAxis screw_axis(const Uncertain<Motion<Dental>>& therapeutic, const Vector3& reference_mm);

}  // namespace gnathion
