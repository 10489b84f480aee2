#include "phantom/jaws_joint.h"

#include <cmath>

#include "core/random.h"
#include "phantom/jaws_surface.h"
#include "phantom/tooth.h"

namespace gnathion {
namespace {

constexpr double kStepMm = 0.5;
constexpr double kJointSpaceMm = 2.0;  ///< between condyle and fossa, above and in front

/// Shape of one joint; the right one is the left one mirrored, with its own sizes.
struct Joint {
  double half_width_mm, half_depth_mm, half_height_mm;  ///< of the condylar head: along its pole axis, y, z
  double axis_deg;     ///< how far the medial pole lies behind the lateral one
  double eminence_mm;  ///< height of the articular eminence under the roof of the fossa
};

Joint random_joint(Random& random) {
  Joint j;
  j.half_width_mm = 9.4 + 0.5 * random.normal();
  j.half_depth_mm = 4.2 + 0.25 * random.normal();
  j.half_height_mm = 4.8 + 0.2 * random.normal();
  j.axis_deg = 17.0 + 3.0 * random.normal();
  j.eminence_mm = 7.0 + 0.6 * random.normal();
  return j;
}

/// Distance to the head of the condyle with its neck. q: lateral, posterior, up from the head's centre.
double condyle_mm(const Joint& j, const Vector3& q) {
  const double a = j.axis_deg * M_PI / 180.0;
  const double lateral = std::cos(a) * q.x() - std::sin(a) * q.y();
  const double back = std::sin(a) * q.x() + std::cos(a) * q.y();
  const Vector3 e(lateral / j.half_width_mm, (back + 0.4) / j.half_depth_mm, q.z() / j.half_height_mm);
  const double k = e.norm();
  const Vector3 slope(e.x() / j.half_width_mm, e.y() / j.half_depth_mm, e.z() / j.half_height_mm);
  const double head = k < 1e-6 ? -j.half_depth_mm : k * (k - 1.0) / slope.norm();
  // The neck: an elliptic column that leans forward as it goes down, flattened in front (pterygoid fovea).
  const double down = -q.z();
  const double nx = lateral / (5.6 - 0.04 * down), ny = (back + 0.16 * down - 0.3) / (3.1 + 0.02 * down);
  const double r = std::hypot(nx, ny);
  const double column = (r - 1.0) * 3.2;
  const double neck = smooth_max(smooth_max(column, q.z() + 1.0, 1.0), down - 18.0, 2.0);
  return smooth_min(head, neck, 2.5);
}

/// Distance to the bone over the joint, negative inside (above). Roof over the head, the eminence in front
/// of it, the postglenoid process behind.
double temporal_mm(const Joint& j, const Vector3& q) {
  const double roof = j.half_height_mm + kJointSpaceMm;
  const double y = q.y() + 0.4;
  const double eminence_y = -(j.half_depth_mm + 8.5);
  const double front = j.eminence_mm * std::exp(-(y - eminence_y) * (y - eminence_y) / 26.0);
  const double behind = 6.0 * std::exp(-(y - 11.5) * (y - 11.5) / 14.0);
  const double side = 0.018 * q.x() * q.x();
  const double surface = roof + 0.4 - front - behind - 0.6 * side;
  return (surface - q.z()) / 1.4;
}

TriangleMesh condyle_of(const Joint& j, const Vector3& centre, double side) {
  Box box;
  box.extend(centre + Vector3(-14, -12, -21));
  box.extend(centre + Vector3(14, 12, 9));
  return polygonised(
      [&](const Vector3& p) {
        const Vector3 q = p - centre;
        return condyle_mm(j, {side * q.x(), q.y(), q.z()});
      },
      box, kStepMm);
}

TriangleMesh fossa_of(const Joint& j, const Vector3& centre, double side) {
  Box box;
  box.extend(centre + Vector3(-15, -22, -6));
  box.extend(centre + Vector3(15, 17, 14));
  const TriangleMesh whole = polygonised(
      [&](const Vector3& p) {
        const Vector3 q = p - centre;
        return temporal_mm(j, {side * q.x(), q.y(), q.z()});
      },
      box, kStepMm);
  return largest_component(trimmed(whole, [&](const Vector3& p) {
    const Vector3 q = p - centre;
    return std::hypot(q.x() / 12.5, (q.y() + 2.5) / 16.5) - 1.0;
  }));
}

}  // namespace

void make_joints(PhantomJaws& jaws, std::uint64_t seed) {
  Random random(seed, 5);
  const Joint right = random_joint(random), left = random_joint(random);
  jaws.condyle_left = condyle_of(left, jaws.landmarks.condyle_left_mm, 1.0);
  jaws.condyle_right = condyle_of(right, jaws.landmarks.condyle_right_mm, -1.0);
  jaws.fossa_left = fossa_of(left, jaws.landmarks.condyle_left_mm, 1.0);
  jaws.fossa_right = fossa_of(right, jaws.landmarks.condyle_right_mm, -1.0);
}

}  // namespace gnathion
