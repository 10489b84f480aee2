#include "phantom/bow.h"

#include <algorithm>
#include <array>
#include <limits>

#include "phantom/bodies_field.h"
#include "phantom/bodies_mesher.h"
#include "phantom/bow_clutch.h"

namespace gnathion {
namespace {

using field::box;
using field::rod;
using field::sphere;
using field::unite;

/// Twelve plates in two rows before and beside the mouth; neighbours are turned against each other by 15–35°.
/// They look a little upward, and the lower row stands before the upper one, for the bow dips as the jaw
/// opens.
std::vector<TagPlate> bow_plates() {
  constexpr std::array<double, 6> x = {-89, -53, -18, 18, 53, 89};
  constexpr std::array<double, 6> y_low = {-67, -84, -78, -89, -77, -66},
                                  y_high = {-50, -66, -72, -69, -63, -54};
  constexpr std::array<double, 6> yaw_low = {14, -10, 12, -14, 10, -12},
                                  yaw_high = {-10, 14, -12, 12, -14, 10};
  constexpr std::array<double, 6> pitch_low = {-3, 18, 0, 20, -2, 16}, pitch_high = {20, -1, 18, -3, 16, 2};
  std::vector<TagPlate> plates;
  for (std::size_t n = 0; n < 6; ++n)
    plates.push_back(tag_plate(static_cast<int>(n), {x[n], y_low[n], -21.5}, yaw_low[n], pitch_low[n],
                               4.0 - 2.0 * static_cast<int>(n)));
  for (std::size_t n = 0; n < 6; ++n)
    plates.push_back(tag_plate(static_cast<int>(n + 6), {x[n] + 1.5, y_high[n], 14.5}, yaw_high[n],
                               pitch_high[n], 3.0 * static_cast<int>(n) - 8.0));
  return plates;
}

/// A bent bar behind the plates, from the patient's right to the left; higher on the left, so that no
/// half-turn maps it on itself.
const std::array<Vector3, 7> kBar = {Vector3(-97, -36, -6), Vector3(-68, -50, -5.5), Vector3(-34, -58, -5),
                                     Vector3(0, -60, -4.5), Vector3(34, -58, -3.5),  Vector3(68, -50, -2),
                                     Vector3(97, -36, 0)};

Vector3 nearest_on_bar(const Vector3& p) {
  Vector3 best = kBar[0];
  for (std::size_t n = 1; n < kBar.size(); ++n) {
    const Vector3 along = kBar[n] - kBar[n - 1];
    const double t = std::clamp((p - kBar[n - 1]).dot(along) / along.squaredNorm(), 0.0, 1.0);
    const Vector3 q = kBar[n - 1] + t * along;
    if ((q - p).norm() < (best - p).norm()) best = q;
  }
  return best;
}

double bar(const Vector3& p) {
  double d = std::numeric_limits<double>::max();
  for (std::size_t n = 1; n < kBar.size(); ++n) d = std::min(d, rod(p, kBar[n - 1], kBar[n], 3.2));
  return d;
}

/// What an intraoral scanner still reaches before the lips: a block, a wedge, a pin and three balls, no two
/// alike and none in line, which fix all six degrees of freedom of the scanned part.
double registration_features(const Vector3& p, double stem_z) {
  const Vector3 base(0, -37, stem_z);
  const Vector3 q = p - base;
  double d = box(exp_so3(Vector3(0, 0, -0.35)) * (q - Vector3(1, 0, 0)), {13, 5, 4.2}, 0.6);
  const auto pin = [&](const Vector3& from, const Vector3& to, double ball) {
    return unite(rod(q, from, to, 1.8), sphere(q, to, ball), 0.8);
  };
  d = unite(d, pin({-9, -2, 0}, {-19, 7, 8}, 4.0), 1.0);
  d = unite(d, pin({10, 3, 0}, {19, 9, -7}, 3.2), 1.0);
  d = unite(d, pin({-3, 2, 2}, {-4, 1, -13}, 2.6), 1.0);
  const Vector3 wedge = exp_so3(Vector3(0.5, 0.3, 0.6)) * (q - Vector3(8, -4, 5));
  d = unite(d, box(wedge, {4.5, 3.2, 3.8}, 0.5), 0.8);
  return d;
}

}  // namespace

PhantomBody make_bow_in_dental(const PhantomJaws& jaws, const ClutchDesign& design) {
  const ClutchField clutch(jaws, design);
  const std::vector<TagPlate> plates = bow_plates();
  std::vector<PlateOnPost> posts;
  for (const TagPlate& plate : plates)
    posts.emplace_back(plate, nearest_on_bar(plate.facing * Vector3(0, 0, -3)));

  // The stem begins at the clutch, as high as its labial face allows, and runs forward between the lips.
  const double top = clutch.top_z_mm(0) - 0.3, bottom = std::max(clutch.bottom_z_mm(0), top - 4.8);
  const double stem_z = 0.5 * (top + bottom), stem_back = clutch.front_y_mm() + 4, stem_front = -40;
  const Vector3 stem_half(5.5, 0.5 * (stem_back - stem_front), 0.5 * (top - bottom));
  const Vector3 stem_middle(0, 0.5 * (stem_back + stem_front), stem_z);
  const auto solid = [&](const Vector3& p) {
    double d = unite(box(p - stem_middle, stem_half, 1.2), clutch.shell(p), 1.2);
    d = clutch.with_room_for_teeth(d, p);
    d = unite(d, registration_features(p, stem_z), 1.5);
    d = unite(d, rod(p, {0, -38, stem_z}, kBar[3], 4.0, 3.6), 2.0);
    d = unite(d, bar(p), 2.0);
    for (const PlateOnPost& post : posts) d = post.united_with(d, p);
    return d;
  };
  Box extent;
  extent.extend({-112, -112, -50});
  extent.extend({112, clutch.back_y_mm() + 5, 45});
  return body_of("bow", solid, extent, plates, 0.7);
}

}  // namespace gnathion
