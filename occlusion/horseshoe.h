// The horseshoe that the crowns of a jaw pair draw in the occlusal plane.
#pragma once

#include <optional>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Area centroid of the convex hull of points in a plane; for a horseshoe it lies in its opening.
Eigen::Vector2d hull_centroid(std::vector<Eigen::Vector2d> points_mm);

struct Opening {
  double direction_rad = 0.0;  ///< middle of the widest empty sector as seen from the centre
  double width_rad = 0.0;
};
/// The sector without points: the open side. Sectors with under 5 % of the median count are empty.
Opening find_opening(const std::vector<Eigen::Vector2d>& points_mm, const Eigen::Vector2d& centre_mm);

/// Smooth curve through the middle of the horseshoe, open side towards +y, from −x to +x, in steps of
/// step_mm. Nothing when fewer than half of the sectors between the ends hold points.
std::optional<std::vector<Eigen::Vector2d>> middle_curve(const std::vector<Eigen::Vector2d>& points_mm,
                                                         const Eigen::Vector2d& centre_mm, double step_mm);

/// Per 4° sector (from −x over −y to +x) the 95th percentile of the distance from the centre; NaN where
/// there are too few points.
std::vector<double> outer_radii(const std::vector<Eigen::Vector2d>& points_mm,
                                const Eigen::Vector2d& centre_mm);

}  // namespace gnathion
