// Whether the mandible can get there from MI: constraint (c).
#include <fmt/format.h>

#include <cmath>

#include "anatomy/constraints.h"

namespace gnathion {
namespace {

constexpr double kKnownCondyleMm = 1.0;  // how far a condyle's centre from its surface can be wrong

/// Displacements from MI in the arch's directions: left, back, up.
struct Displacements {
  Vector3 incisal, left, right;
};

}  // namespace

std::vector<Constraint> reachable_from_mi(const JawsInTp& jaws) {
  const ArchFrame& arch = jaws.arch;
  const RealizabilityLimits& limits = jaws.limits;
  const Rigid3& therapeutic = jaws.therapeutic;
  const Matrix3& to_arch = arch.arch_from_dental.rotation;
  const Vector3 turn_deg = to_arch * log_so3(therapeutic.rotation) * (180.0 / M_PI);
  const bool both_known = jaws.joints.left && jaws.joints.right;
  const double slack_mm =
      (both_known ? kKnownCondyleMm : limits.condyle_uncertainty_mm) * therapeutic.angle_rad();
  const auto moved = [&](const Vector3& p) -> Vector3 { return to_arch * (therapeutic * p - p); };
  const Vector3 condyles[2] = {jaws.condyle_left_mm, jaws.condyle_right_mm};
  const Vector3 between_condyles = 0.5 * (condyles[0] + condyles[1]);
  const Displacements moves{moved(arch.incisal_mm), moved(condyles[0]), moved(condyles[1])};
  const Vector3 back = -arch.anterior;

  std::vector<Constraint> out;
  const auto check = [&](const char* name, double value, const Vector3& where, const Vector6& gradient,
                         double slack, const char* otherwise) {
    Constraint c = constraint_of(jaws.table, name);
    c.value = value;
    c.limit += slack;
    c.pass = c.value <= c.limit;
    c.where_mm = therapeutic * where;
    c.gradient = gradient;
    c.consequence = c.pass ? "within the mandible's usual range" : otherwise;
    out.push_back(std::move(c));
  };
  const auto turn = [&](const char* name, double value, const Vector3& where, const Vector3& axis,
                        const char* otherwise) {
    check(name, value, where, turn_gradient_deg(axis), 0.0, otherwise);
  };
  const auto shift = [&](const char* name, double value, const Vector3& where, const Vector3& direction,
                         double slack, const char* otherwise) {
    check(name, value, where, gradient_at(therapeutic * where, direction), slack, otherwise);
  };
  // Of two condyles, the one that goes farther along an arch direction.
  const auto worse = [&](const char* name, int axis, const Vector3& direction, double sign,
                         const char* otherwise) {
    const bool first = sign * moves.left(axis) >= sign * moves.right(axis);
    shift(name, sign * (first ? moves.left : moves.right)(axis), condyles[first ? 0 : 1], sign * direction,
          slack_mm, otherwise);
  };
  turn("opening_rotation", turn_deg.x(), arch.incisal_mm, arch.left,
       "the mandible would have to open wider than it can");
  turn("closing_rotation", 0.0 - turn_deg.x(), arch.incisal_mm, -arch.left,
       "the front teeth would have to close past MI");
  turn("yaw", std::abs(turn_deg.z()), arch.origin_mm, arch.up,
       "asymmetric: one joint would be pressed back, the other pulled out");
  turn("roll", std::abs(turn_deg.y()), arch.origin_mm, back,
       "asymmetric: one joint would be pulled apart, the other compressed");
  shift("vertical_opening", -moves.incisal.z(), arch.incisal_mm, -arch.up, 0.0,
        "the splint would be too thick to be worn");
  shift("protrusion", -moves.incisal.y(), arch.incisal_mm, arch.anterior, 0.0,
        "the mandible would have to come farther forward than it can");
  shift("laterotrusion", std::abs(moves.incisal.x()), arch.incisal_mm, arch.left, 0.0,
        "the mandible would have to go farther to the side than it can");
  worse("condyle_forward", 1, back, -1.0, "a condyle would leave its joint forwards");
  worse("condyle_back", 1, back, 1.0,
        "a condyle would be pressed back out of its fossa: the joint would be overloaded");
  worse("condyle_up", 2, arch.up, 1.0, "a condyle would be pressed into the roof of its fossa");
  worse("condyle_down", 2, arch.up, -1.0, "a condyle would be pulled out of its joint");
  shift("condyle_lateral", std::abs(0.5 * (moves.left.x() + moves.right.x())), between_condyles, arch.left,
        slack_mm, "both condyles would have to shift sideways farther than joints allow");
  return out;
}

Constraint recorded_envelope(const JawsInTp& jaws) {
  Constraint c = constraint_of(jaws.table, "recorded_envelope");
  const EnvelopeDistance d = jaws.envelope->distance(jaws.therapeutic);
  c.value = d.outside_mm;
  c.pass = c.value <= c.limit;
  c.where_mm = d.where_mm;
  c.consequence =
      c.value <= 0.0
          ? fmt::format("inside the patient's recorded motion, {:.2f} mm from its nearest position",
                        d.nearest_mm)
          : fmt::format(
                "{:.2f} mm outside the patient's recorded motion at the {}, {:.2f} mm from its nearest "
                "position{}",
                d.outside_mm, d.landmark, d.nearest_mm,
                c.pass ? "" : ": the patient was not seen to reach it");
  return c;
}

}  // namespace gnathion
