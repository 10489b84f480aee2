#include "tracking/slip.h"
#include "core/angle.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Cholesky>

namespace gnathion {
namespace {

constexpr double kLever_mm = 80;
constexpr double kConsistent = 20.1;            // χ² of 6 degrees of freedom, 99.73 % (3σ)
constexpr std::size_t kWindow = 15, kSkip = 2;  // rows on either side of a jump, and next to it left out

/// A step of the head frame against its own smooth movement, and when: displacement of the teeth (mm) and
/// rotation times a lever (mm), so that both count alike.
struct Step {
  double time_s;
  Vector6 value;
};

Vector6 told_at(const Rigid3& motion, const Vector3& point_mm) {
  Vector6 v;
  v << kLever_mm * log_so3(motion.rotation), motion * point_mm - point_mm;
  return v;
}

/// Head pose that a straight line through rows [first, first + kWindow) predicts at a time, about `about`.
Vector6 line_at(const std::vector<const MotionRow*>& rows, std::size_t first, const Rigid3& about,
                double time_ns) {
  Vector6 mean = Vector6::Zero(), slope = Vector6::Zero();
  double mean_t = 0, tt = 0;
  std::vector<Vector6> logs;
  for (std::size_t i = 0; i < kWindow; ++i) {
    const MotionRow& row = *rows[first + i];
    logs.push_back(log_se3(about.inverse() * row.head.camera_from_body));
    mean += logs.back() / kWindow;
    mean_t += (static_cast<double>(row.capture.ns) - time_ns) / kWindow;
  }
  for (std::size_t i = 0; i < kWindow; ++i) {
    const double t = static_cast<double>(rows[first + i]->capture.ns) - time_ns - mean_t;
    tt += t * t;
    slope += t * (logs[i] - mean);
  }
  return mean - mean_t * slope / tt;
}

/// Steps of the head frame at every row that has enough rows without a gap on both sides.
std::vector<Step> steps_of(const SessionMotion& session, const Vector3& point_in_head_mm) {
  std::vector<const MotionRow*> rows;
  for (const MotionRow& row : session.rows)
    if (row.head.valid) rows.push_back(&row);
  std::vector<Step> steps;
  constexpr std::size_t kReach = kWindow + kSkip;
  for (std::size_t i = kReach; i + kReach < rows.size(); ++i) {
    const double span = rows[i + kReach]->capture.seconds_since(rows[i - kReach]->capture);
    if (span > 2.5) continue;  // a gap: the head may have moved in it
    const Rigid3& about = rows[i]->head.camera_from_body;
    const double t = static_cast<double>(rows[i]->capture.ns);
    const Rigid3 before = exp_se3(line_at(rows, i - kReach, about, t));
    const Rigid3 after = exp_se3(line_at(rows, i + kSkip + 1, about, t));
    steps.push_back({session.time_s(*rows[i]), told_at(before.inverse() * after, point_in_head_mm)});
  }
  return steps;
}

double usual_size(const std::vector<Step>& steps) {
  std::vector<double> sizes;
  for (const Step& s : steps) sizes.push_back(s.value.norm());
  if (sizes.empty()) return 0;
  const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), at, sizes.end());
  return *at;
}

/// How long the head frame was not seen at most between two times.
double longest_blind_s(const SessionMotion& session, double from_s, double to_s) {
  double longest = 0, last = from_s;
  for (const MotionRow& row : session.rows) {
    const double t = session.time_s(row);
    if (!row.head.valid || t < from_s || t > to_s) continue;
    longest = std::max(longest, t - last);
    last = t;
  }
  return std::max(longest, to_s - last);
}

/// A slipped head frame turns R into S⁻¹·R and jumps by S itself in the camera: the same S, seen twice.
void tell_cause(const SessionMotion& session, const std::vector<Step>& steps, double noise_mm,
                const Vector6& expected, double from_s, double to_s, Slip* slip) {
  const double size = expected.norm();
  const Step* best = nullptr;
  double least = 1e300;
  for (const Step& s : steps) {
    if (s.time_s < from_s || s.time_s > to_s) continue;
    const double off = (s.value - expected).norm();
    if (off < least) least = off, best = &s;
  }
  const double blind = longest_blind_s(session, from_s, to_s);
  if (size < 4 * noise_mm || best == nullptr) {
    slip->why = best == nullptr
                    ? "the head frame was not followed long enough"
                    : fmt::format(
                          "a jump of {:.2f} mm does not stand out of the head's own movement ({:.2f} "
                          "mm)",
                          size, noise_mm);
  } else if (least <= std::max(0.5 * size, 2.5 * noise_mm) && best->value.norm() > 3 * noise_mm) {
    slip->cause = SlipCause::kHeadFrame;
    slip->at_s = best->time_s;
    slip->seen = true;
    slip->why = "the head frame jumped in the camera by what the closure lacks";
  } else if (blind > 0.3) {
    slip->why = fmt::format("the head frame was not seen for {:.1f} s in between", blind);
  } else {
    slip->cause = SlipCause::kBow;
    slip->why = "the head frame shows no such jump";
  }
}

}  // namespace

std::string Slip::text() const {
  std::string what = "bow or head frame slipped";
  if (cause == SlipCause::kHeadFrame) what = fmt::format("the head frame slipped at {:.1f} s", at_s);
  if (cause == SlipCause::kBow) what = "the bow slipped on the teeth, or the bite differs";
  return fmt::format("between MI {} and {} ({:.3f} mm, {:.3f} deg): {}: {}", before + 1, after + 1,
                     distance_mm, angle_deg, what, why);
}

std::vector<Slip> find_slips(const SessionMotion& session, const JawPositions& positions,
                             const PlateauOptions& options) {
  std::vector<Slip> slips;
  std::vector<Step> steps;
  for (std::size_t i = 1; i < positions.mi.size(); ++i) {
    const Plateau &a = positions.mi[i - 1], &b = positions.mi[i];
    const Vector6 xi = difference(b.head_from_bow.value.rigid, a.head_from_bow.value.rigid);
    const Matrix6 cov = a.head_from_bow.covariance + b.head_from_bow.covariance;
    if (xi.dot(cov.ldlt().solve(xi)) <= kConsistent) continue;
    const Vector3 point = a.head_from_bow.value * options.point_in_bow_mm;
    Slip slip;
    slip.before = i - 1;
    slip.after = i;
    slip.distance_mm = (exp_se3(xi) * point - point).norm();
    slip.angle_deg = xi.head<3>().norm() / kRadPerDeg;
    if (steps.empty()) steps = steps_of(session, point);
    tell_cause(session, steps, usual_size(steps), told_at(exp_se3(Vector6(-xi)), point), a.start_s, b.end_s,
               &slip);
    slips.push_back(std::move(slip));
  }
  return slips;
}

}  // namespace gnathion
