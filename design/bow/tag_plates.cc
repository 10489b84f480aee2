#include "design/bow/tag_plates.h"

#include <array>
#include <numbers>

#include "core/check.h"
#include "design/bow/shapes.h"

namespace gnathion {
namespace {

constexpr std::size_t kMostPlates = 16;

}  // namespace

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
  GNATHION_CHECK(plates_.size() <= kMostPlates);
  for (const TagPlate& plate : plates_) plate_from_body_.push_back(plate.body_from_plate.inverse());
}

double PlateSolids::joined(double other_mm, const Vector3& p_mm) const {
  const double top = floor_ + kPocketDepth_mm, middle = top - 0.5 * kPlateThickness_mm;
  double rods = other_mm, front = 1e3;
  std::array<Vector3, kMostPlates> local;
  std::array<bool, kMostPlates> far{};
  double apart = 1e3;  // to the plates that are too far to matter
  for (std::size_t i = 0; i < plates_.size(); ++i) {
    local[i] = plate_from_body_[i] * p_mm;
    const Vector3 centre = plates_[i].body_from_plate * Vector3(0, 0, middle), &root = plates_[i].root_mm;
    const double away =
        (p_mm - 0.5 * (root + centre)).norm() - 0.5 * (root - centre).norm() - 1.5 * half_side_;
    far[i] = away > 3;
    apart = std::min(apart, far[i] ? away : apart);
    if (far[i]) continue;
    rods = shape::join(rods, shape::capsule(p_mm, centre, root, kPost_mm), 2.0);
    front = std::min(front, shape::block(local[i] - Vector3(0, 0, middle + 6),
                                         {half_side_ + 0.5, half_side_ + 0.5, 6}, 0.0));
  }
  rods = std::max(rods, -front);  // before a plate's middle stand neither posts nor fillets
  double d = std::min(rods, apart), pocket = 1e3;
  for (std::size_t i = 0; i < plates_.size(); ++i) {
    if (far[i]) continue;
    const double plate = shape::block(local[i] - Vector3(0, 0, middle),
                                      {half_side_, half_side_, 0.5 * kPlateThickness_mm}, 0.3);
    d = std::min(d, shape::join(rods, plate, 1.5));
    pocket = std::min(
        pocket, shape::block(local[i] - Vector3(0, 0, floor_ + 1), {pocket_half_, pocket_half_, 1}, 0.0));
  }
  return std::max(d, -pocket);
}

}  // namespace gnathion
