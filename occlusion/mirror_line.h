// The line in a plane about which a set of points is most symmetric.
#pragma once

#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Points x with normal(angle) · x = offset_mm.
struct MirrorLine {
  double normal_angle_rad = 0.0;
  double offset_mm = 0.0;
  double rms_mm = 0.0;  ///< of the kept pairs
  Eigen::Vector2d normal() const { return {std::cos(normal_angle_rad), std::sin(normal_angle_rad)}; }
  Eigen::Vector2d mirrored(const Eigen::Vector2d& p) const {
    return p - 2.0 * (normal().dot(p) - offset_mm) * normal();
  }
};

/// Closest-point iterations from `start`: points are mirrored, paired with their nearest neighbours, and
/// the line is moved by Gauss-Newton. Pairs farther apart than reach_mm count nothing (teeth that are
/// missing on one side); the reach narrows to 2 mm.
MirrorLine refine_mirror_line(const std::vector<Eigen::Vector2d>& points_mm, MirrorLine start,
                              double reach_mm = 8.0);

}  // namespace gnathion
