#include "phantom/bodies.h"

#include <algorithm>
#include <numbers>

#include "phantom/bodies_field.h"
#include "phantom/bodies_mesher.h"

namespace gnathion {

TagPlate tag_plate(int id, const Vector3& centre_mm, double yaw_deg, double pitch_deg, double roll_deg) {
  constexpr double kRad = std::numbers::pi / 180.0;
  // Untilted: plate x = patient's left (the viewer's right), plate y = up, plate z = to the front (-y).
  Matrix3 front;
  front.col(0) = Vector3::UnitX();
  front.col(1) = Vector3::UnitZ();
  front.col(2) = -Vector3::UnitY();
  const Matrix3 tilt = exp_so3(Vector3(0, 0, yaw_deg * kRad)) * exp_so3(Vector3(-pitch_deg * kRad, 0, 0));
  return {id, {tilt * front * exp_so3(Vector3(0, 0, roll_deg * kRad)), centre_mm}};
}

BodyTag tag_of(const TagPlate& plate) {
  constexpr double h = kTagSide_mm / 2;
  return {plate.id,
          {plate.facing * Vector3(-h, -h, 0), plate.facing * Vector3(h, -h, 0),
           plate.facing * Vector3(h, h, 0), plate.facing * Vector3(-h, h, 0)}};
}

PlateOnPost::PlateOnPost(const TagPlate& plate, const Vector3& anchor_mm)
    : plate_from_space_(plate.facing.inverse()),
      post_from_mm_(plate.facing * Vector3(0, 0, -kPlateThickness_mm - 1.0)),
      post_to_mm_(anchor_mm),
      middle_mm_(0.5 * (plate.facing.translation_mm + anchor_mm)),
      reach_mm_(0.5 * (plate.facing.translation_mm - anchor_mm).norm() + 0.8 * kPlateSide_mm) {}

double PlateOnPost::united_with(double other_mm, const Vector3& p_mm) const {
  constexpr double kFillet_mm = 2.0;
  if ((p_mm - middle_mm_).norm() - reach_mm_ > other_mm + kFillet_mm) return other_mm;
  const Vector3 half(0.5 * kPlateSide_mm, 0.5 * kPlateSide_mm, 0.5 * kPlateThickness_mm);
  const Vector3 local = plate_from_space_ * p_mm + Vector3(0, 0, half.z());
  const double plate = field::box(local, half, 0.4);
  const double post = field::rod(p_mm, post_from_mm_, post_to_mm_, 2.4);
  // A small fillet behind the plate, so that its front stays flat.
  return field::unite(other_mm, field::unite(plate, post, 1.0), kFillet_mm);
}

PhantomBody body_of(const char* name, const std::function<double(const Vector3&)>& solid, const Box& box,
                    const std::vector<TagPlate>& plates, double edge_mm) {
  PhantomBody body;
  // Rims that follow a slanted profile make the field steeper than a distance.
  body.surface = without_islands(mesh_of_field(solid, box, edge_mm, 1.8), 1000);
  body.tags.name = name;
  for (const TagPlate& plate : plates) body.tags.tags.push_back(tag_of(plate));
  return body;
}

PhantomBody transformed(const Rigid3& to_from_body, const PhantomBody& body) {
  PhantomBody out{transformed(to_from_body, body.surface), body.tags};
  for (BodyTag& tag : out.tags.tags)
    for (Vector3& corner : tag.corners_in_body_mm) corner = to_from_body * corner;
  return out;
}

}  // namespace gnathion
