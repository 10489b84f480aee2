// Plates that carry tags, with a pocket for the sticker, on posts. Private to design/bow/.
#pragma once

#include <vector>

#include "core/camera_model.h"
#include "design/bow/bow_parameters.h"

namespace gnathion {

inline constexpr double kPlateThickness_mm = 2.0;
inline constexpr double kPocketDepth_mm = 0.3;
inline constexpr double kPocketClearance_mm = 0.1;  ///< about the sticker, each side
inline constexpr double kPocketRim_mm = 1.6;
inline constexpr double kPost_mm = 2.6;  ///< radius

/// Side of the sticker: tag36h11 is eight cells wide, with one white cell about it.
double sticker_side_mm(const BowParameters& p);
double plate_side_mm(const BowParameters& p);

/// Plate coordinates: x to the viewer's right, y up, z towards the viewer, origin in the middle of the tag's
/// plane (the sticker's front).
struct TagPlate {
  int id = 0;
  Rigid3 body_from_plate;
  Vector3 root_mm = Vector3::Zero();  ///< where its post begins, body frame
};

/// Looks along −y (away from the patient), turned by yaw to the patient's left and by pitch upwards.
TagPlate tag_plate_at(int id, const Vector3& centre_mm, double yaw_deg, double pitch_deg);
BodyTag tag_on(const TagPlate& plate, double side_mm);

/// All plates of a body as a solid.
class PlateSolids {
 public:
  PlateSolids(std::vector<TagPlate> plates, const BowParameters& p);
  /// `other_mm` (a distance) with plates and posts joined to it, pockets cut.
  double joined(double other_mm, const Vector3& p_mm) const;
  const std::vector<TagPlate>& plates() const { return plates_; }

 private:
  std::vector<TagPlate> plates_;
  std::vector<Rigid3> plate_from_body_;
  double half_side_, pocket_half_, floor_;
};

}  // namespace gnathion
