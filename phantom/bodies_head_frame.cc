#include "phantom/bodies_head_frame.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "phantom/bodies_field.h"

namespace gnathion {
namespace {

using field::rod;
using field::unite;

constexpr double kBandRadius_mm = 2.8;
constexpr double kBandAboveSkin_mm = 7.5;  ///< of the band's axis
constexpr double kPadGap_mm = 0.2;         ///< between pads and skin

/// Ten plates: a row before the upper forehead and a lower one beside the eyes, looking down to the camera.
std::vector<TagPlate> head_plates() {
  constexpr std::array<double, 6> x = {-81, -48, -16, 16, 48, 81}, y = {-14, -30, -37, -44, -29, -16};
  constexpr std::array<double, 6> z = {111, 115, 114, 116, 114, 114};
  constexpr std::array<double, 6> yaw = {-12, 13, -11, 14, -12, 12}, pitch = {-20, 2, -22, -2, -18, 0};
  std::vector<TagPlate> plates;
  for (std::size_t n = 0; n < 6; ++n)
    plates.push_back(tag_plate(static_cast<int>(20 + n), {x[n], y[n], z[n]}, yaw[n], pitch[n],
                               5.0 - 2.0 * static_cast<int>(n)));
  plates.push_back(tag_plate(26, {-73, -7, 76}, 15, -2, -4));
  plates.push_back(tag_plate(27, {-110, -3, 79}, -10, -18, 3));
  plates.push_back(tag_plate(28, {74, -3, 77}, -13, -20, 6));
  plates.push_back(tag_plate(29, {110, 5, 81}, 12, 0, -5));
  return plates;
}

/// Where a ray from the middle of the head in the direction of `azimuth` (0: to the front, positive: to the
/// patient's left) meets the level `above_skin_mm`.
Vector3 on_band(const FaceShape& face, double azimuth_rad, double above_skin_mm) {
  // The band rises slightly towards the front.
  const Vector3 centre(0, 75, 92), direction(std::sin(azimuth_rad), -std::cos(azimuth_rad), 0.06);
  double inside = 20, outside = 140;
  while (outside - inside > 1e-6) {
    const double mid = 0.5 * (inside + outside);
    (skin_distance_mm(face, centre + mid * direction) < above_skin_mm ? inside : outside) = mid;
  }
  return centre + inside * direction;
}

struct Band {
  std::vector<Vector3> axis;
  std::vector<std::array<Vector3, 2>> pads;  ///< from the band to the skin

  explicit Band(const FaceShape& face) {
    constexpr double kRad = std::numbers::pi / 180.0;
    for (int degrees = -100; degrees <= 100; degrees += 5)
      axis.push_back(on_band(face, degrees * kRad, kBandAboveSkin_mm));
    for (const double degrees : {-97.0, -46.0, 3.0, 50.0, 97.0})
      pads.push_back({on_band(face, degrees * kRad, kBandAboveSkin_mm),
                      on_band(face, degrees * kRad, kPadGap_mm + kPadRadius_mm)});
  }
  double distance(const Vector3& p) const {
    double d = std::numeric_limits<double>::max();
    for (std::size_t n = 1; n < axis.size(); ++n)
      d = std::min(d, rod(p, axis[n - 1], axis[n], kBandRadius_mm));
    for (const auto& pad : pads) d = unite(d, rod(p, pad[0], pad[1], kPadRadius_mm), 1.5);
    return d;
  }
  Vector3 nearest(const Vector3& p) const {
    return *std::min_element(axis.begin(), axis.end(), [&](const Vector3& a, const Vector3& b) {
      return (a - p).squaredNorm() < (b - p).squaredNorm();
    });
  }

  static constexpr double kPadRadius_mm = 4.5;
};

}  // namespace

PhantomBody make_head_frame_in_dental(const FaceShape& face) {
  const Band band(face);
  const std::vector<TagPlate> plates = head_plates();
  std::vector<PlateOnPost> posts;
  for (const TagPlate& plate : plates)
    posts.emplace_back(plate, band.nearest(plate.facing * Vector3(0, 0, -3)));
  const auto solid = [&](const Vector3& p) {
    double d = band.distance(p);
    for (const PlateOnPost& post : posts) d = post.united_with(d, p);
    return d;
  };
  Box extent;
  extent.extend({-128, -65, 55});
  extent.extend({128, 110, 138});
  return body_of("head_frame", solid, extent, plates, 0.8);
}

}  // namespace gnathion
