// What the finished bow is, measured on its mesh. Private to design/bow/.
#pragma once

#include "design/bow/bow.h"
#include "design/bow/clutch.h"

namespace gnathion {

/// Fills gates, violated, verdict, volume, mass and bonding area.
void verify_bow(const ClutchScene& scene, const Clutch& clutch, const BowParameters& p, BowDesign& design);

/// How many of a body's tags a camera sees: at `distance_mm` from their middle, in the direction `yaw` to the
/// patient's left and `pitch` up from the front; tilted by 60° at most, with nothing before them.
int visible_tags(const PrintedBody& body, const MeshQuery& surface, double yaw_rad, double pitch_rad,
                 double distance_mm);

/// Standard deviation that one frame leaves at a point of the body, mm (largest direction): a camera with
/// f = 1100 px in front at 400 mm and corners known to 0.05 px.
double predicted_sigma_mm(const PrintedBody& body, const MeshQuery& surface, const Vector3& at_mm);

/// Thinnest place: through the solid along the inward normal to a face that looks the other way (within 45°).
double thinnest_wall_mm(const MeshQuery& surface, Vector3* where_mm);

}  // namespace gnathion
