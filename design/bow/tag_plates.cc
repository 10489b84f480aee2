#include "design/bow/tag_plates.h"

#include <numbers>

#include "design/bow/shapes.h"

namespace gnathion {

double sticker_side_mm(const BowParameters& p) {
  return p.tag_side_mm * 10.0 / 8.0;
}

double plate_side_mm(const BowParameters& p) {
  return sticker_side_mm(p) + 2 * (kPocketClearance_mm + kPocketRim_mm);
}

TagPlate tag_plate_at(int id, const Vector3& centre_mm, double yaw_deg, double pitch_deg) {
  constexpr double kRad = std::numbers::pi / 180;
  Matrix3 front;
  front.col(0) = Vector3::UnitX();
  front.col(1) = Vector3::UnitZ();
  front.col(2) = -Vector3::UnitY();
  const Matrix3 turn = exp_so3(Vector3(0, 0, yaw_deg * kRad)) * exp_so3(Vector3(-pitch_deg * kRad, 0, 0));
  return {id, {turn * front, centre_mm}, centre_mm};
}

BodyTag tag_on(const TagPlate& plate, double side_mm) {
  const double h = side_mm / 2;
  return {plate.id,
          {plate.body_from_plate * Vector3(-h, -h, 0), plate.body_from_plate * Vector3(h, -h, 0),
           plate.body_from_plate * Vector3(h, h, 0), plate.body_from_plate * Vector3(-h, h, 0)}};
}

PlateSolids::PlateSolids(std::vector<TagPlate> plates, const BowParameters& p)
    : plates_(std::move(plates)),
      half_side_(plate_side_mm(p) / 2),
      pocket_half_(sticker_side_mm(p) / 2 + kPocketClearance_mm),
      floor_(-p.sticker_thickness_mm) {
  for (const TagPlate& plate : plates_) plate_from_body_.push_back(plate.body_from_plate.inverse());
}

double PlateSolids::joined(double other_mm, const Vector3& p_mm) const {
  const double top = floor_ + kPocketDepth_mm, middle = top - 0.5 * kPlateThickness_mm;
  double d = other_mm, pocket = 1e3;
  for (std::size_t i = 0; i < plates_.size(); ++i) {
    const Vector3& root = plates_[i].root_mm;
    const Vector3 back = plates_[i].body_from_plate * Vector3(0, 0, top - kPlateThickness_mm);
    const double reach = 0.5 * (root - back).norm() + 0.75 * 2 * half_side_;
    const double apart = (p_mm - 0.5 * (root + back)).norm() - reach;
    if (apart > d + 3 && apart > 3) {
      d = std::min(d, apart);
      continue;
    }
    const Vector3 local = plate_from_body_[i] * p_mm;
    const double plate =
        shape::block(local - Vector3(0, 0, middle), {half_side_, half_side_, 0.5 * kPlateThickness_mm}, 0.3);
    const double post =
        shape::capsule(p_mm, plates_[i].body_from_plate * Vector3(0, 0, middle), root, kPost_mm);
    d = shape::join(d, shape::join(plate, post, 2.0), 1.5);
    pocket = std::min(pocket,
                      shape::block(local - Vector3(0, 0, floor_ + 5), {pocket_half_, pocket_half_, 5}, 0.0));
    // Before the pocket nothing stands: neither fillets nor posts.
    pocket = std::min(pocket, shape::block(local - Vector3(0, 0, top + 4), {half_side_, half_side_, 4}, 0.0));
  }
  return std::max(d, -pocket);
}

}  // namespace gnathion
