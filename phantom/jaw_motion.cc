#include "phantom/jaw_motion.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kDegree = M_PI / 180.0;

/// 0 to 1 over [from, to], C2: velocity and acceleration vanish at both ends.
double rise(double x, double from, double to) {
  const double u = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return u * u * u * (10 + u * (6 * u - 15));
}

/// Up over [a, b], down over [c, d].
double bump(double x, double a, double b, double c, double d) {
  return rise(x, a, b) - rise(x, c, d);
}

/// 0 to 1 over [0, 1] at constant speed but for a smooth start and end of length `ease`, C2.
double glide(double x, double ease) {
  const auto ramp_integral = [](double u) { return u * u * u * u * (2.5 + u * (u - 3)); };
  const double total = 1 - ease;
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  if (x < ease) return ease * ramp_integral(x / ease) / total;
  if (x > 1 - ease) return 1 - ease * ramp_integral((1 - x) / ease) / total;
  return (x - 0.5 * ease) / total;
}

/// Displacement of a condyle that has slid `s` along its path. The eminence flattens: the slope at
/// 10 mm is about half of that at the start.
Vector3 along_condylar_path(double s, double inclination) {
  const double flattening = 0.025 * std::sin(inclination);
  return {0, -s * std::cos(inclination), -s * std::sin(inclination) + flattening * s * s};
}

}  // namespace

Motion<Dental> motion_of(const JawState& state, const JawGeometry& geometry) {
  const Vector3 shift(state.side_shift_mm, 0, 0);
  const Vector3 left = geometry.condyle_left_mm + shift +
                       along_condylar_path(state.slide_left_mm, geometry.condylar_inclination_rad);
  const Vector3 right = geometry.condyle_right_mm + shift +
                        along_condylar_path(state.slide_right_mm, geometry.condylar_inclination_rad);
  const Vector3 axis_mi = geometry.condyle_left_mm - geometry.condyle_right_mm, axis = left - right;
  const Vector3 centre_mi = 0.5 * (geometry.condyle_left_mm + geometry.condyle_right_mm);
  const Vector3 centre = 0.5 * (left + right);
  // The condyles carry the axis; the jaw then turns about it. With the axis to the left and the teeth
  // in front of it, a positive angle lowers them.
  const Matrix3 swing = Eigen::Quaterniond::FromTwoVectors(axis_mi, axis).toRotationMatrix();
  const Matrix3 rotation = Eigen::AngleAxisd(state.opening_rad, axis.normalized()).toRotationMatrix() * swing;
  return Motion<Dental>(Rigid3{rotation, centre - rotation * centre_mi});
}

JawSequence::JawSequence(const JawGeometry& geometry, const Motion<Dental>& therapeutic,
                         const JawSequenceOptions& options)
    : geometry_(geometry), therapeutic_log_(log_se3(therapeutic.rigid)), options_(options) {
  GNATHION_CHECK(options.duration_s > 0);
  seed_variation(options.seed, options.tremor_mm);
  plan(options.border_movements);
}

void JawSequence::add(JawPhaseKind kind, std::string name, double duration_s, bool marked) {
  const double start = phases_.empty() ? 0.0 : phases_.back().end_s();
  phases_.push_back({kind, std::move(name), start, duration_s, marked});
}

void JawSequence::plan(bool border_movements) {
  add(JawPhaseKind::kRest, "rest", 0.6);
  add(JawPhaseKind::kTransfer, "rest to MI", 0.4);
  add(JawPhaseKind::kMi, "MI", 0.85, true);
  if (border_movements) {
    add(JawPhaseKind::kOpening, "opening", 1.7);
    add(JawPhaseKind::kMi, "MI", 0.2);
    add(JawPhaseKind::kProtrusion, "protrusion", 1.1);
    add(JawPhaseKind::kMi, "MI", 0.15);
    add(JawPhaseKind::kLaterotrusionLeft, "laterotrusion left", 1.1);
    add(JawPhaseKind::kMi, "MI", 0.15);
    add(JawPhaseKind::kLaterotrusionRight, "laterotrusion right", 1.1);
    add(JawPhaseKind::kMi, "MI", 0.15);
    add(JawPhaseKind::kChewing, "chewing", 0.75 * options_.chewing_cycles);
    add(JawPhaseKind::kMi, "MI", 0.75, true);
  }
  for (int pass = 0; pass < 2; ++pass) {
    add(JawPhaseKind::kTransfer, "MI to TP", 0.55);
    add(JawPhaseKind::kTp, "TP", 0.9, true);
    add(JawPhaseKind::kTransfer, "TP to MI", 0.55);
    add(JawPhaseKind::kMi, "MI", 0.75, true);
  }
  add(JawPhaseKind::kTransfer, "MI to rest", 0.3);
  add(JawPhaseKind::kRest, "rest", 0.3);
  const double stretch = options_.duration_s / phases_.back().end_s();
  for (JawPhase& phase : phases_) {
    phase.start_s *= stretch;
    phase.duration_s *= stretch;
  }
}

void JawSequence::seed_variation(std::uint64_t seed, double tremor_mm) {
  Random random(seed, 0x6a6177);
  protrusion_mm_ = random.uniform(5.5, 7.0);
  laterotrusion_mm_ = random.uniform(7.0, 9.0);
  chewing_opening_rad_ = random.uniform(10.0, 13.0) * kDegree;
  chewing_slide_mm_ = random.uniform(3.0, 4.5);
  chewing_side_ = random.below(2) ? 1 : -1;
  rest_opening_rad_ = random.uniform(1.4, 1.7) * kDegree;
  // Physiological tremor: four lines between 8 and 12 Hz, half of it turning about the condyles.
  const Vector3 centre = 0.5 * (geometry_.condyle_left_mm + geometry_.condyle_right_mm);
  const double lever = (geometry_.incisal_point_mm - centre).norm();
  for (int i = 0; i < 4; ++i) {
    const Vector3 turn = random.normal3() * (0.5 * tremor_mm / lever);
    const Vector3 shift = random.normal3() * (0.5 * tremor_mm) - turn.cross(centre);
    Tremor line{random.uniform(8.0, 12.0), random.uniform(0, 2 * M_PI), Vector6::Zero()};
    line.amplitude << turn, shift;
    tremor_.push_back(line);
  }
}

JawSequence::Pose JawSequence::transfer_pose(const JawPhase& phase, double f) const {
  const auto index = static_cast<std::size_t>(&phase - phases_.data());
  const JawPhaseKind from = phases_[index - 1].kind, to = phases_[index + 1].kind;
  const auto resting = [&](JawPhaseKind kind) { return kind == JawPhaseKind::kRest ? rest_opening_rad_ : 0; };
  const auto therapeutic = [](JawPhaseKind kind) { return kind == JawPhaseKind::kTp ? 1.0 : 0.0; };
  Pose pose;
  pose.joints.opening_rad = resting(from) + (resting(to) - resting(from)) * rise(f, 0, 1);
  pose.tp = therapeutic(from) + (therapeutic(to) - therapeutic(from)) * rise(f, 0.2, 0.8);
  // The teeth part before the jaw moves sideways or forward, and meet again at the end.
  const bool through_tp = from == JawPhaseKind::kTp || to == JawPhaseKind::kTp;
  if (through_tp) pose.joints.opening_rad += 3 * kDegree * bump(f, 0, 0.4, 0.6, 1);
  return pose;
}

JawSequence::Pose JawSequence::pose_in(const JawPhase& phase, double f) const {
  Pose pose;
  JawState& q = pose.joints;
  switch (phase.kind) {
    case JawPhaseKind::kMi:
      break;
    case JawPhaseKind::kRest:
      q.opening_rad = rest_opening_rad_;
      break;
    case JawPhaseKind::kTp:
      pose.tp = 1;
      break;
    case JawPhaseKind::kTransfer:
      return transfer_pose(phase, f);
    case JawPhaseKind::kOpening: {
      // Mostly hinge at first, then the condyles leave the fossae (Posselt).
      const double way = bump(f, 0, 0.45, 0.55, 1);
      q.opening_rad = options_.opening_rad * way;
      q.slide_left_mm = 11 * way * (0.3 + 0.7 * way);
      q.slide_right_mm = q.slide_left_mm + 0.8 * way * (1 - way);  // a slight deviation on the way
      break;
    }
    case JawPhaseKind::kProtrusion:
      q.opening_rad = 2.2 * kDegree * bump(f, 0, 0.32, 0.68, 1);
      q.slide_left_mm = q.slide_right_mm = protrusion_mm_ * bump(f, 0.14, 0.48, 0.52, 0.86);
      break;
    case JawPhaseKind::kLaterotrusionLeft:
    case JawPhaseKind::kLaterotrusionRight: {
      // The balancing condyle orbits forward; the working one turns and shifts sideways (Bennett).
      const double way = bump(f, 0.16, 0.48, 0.52, 0.84);
      const bool left = phase.kind == JawPhaseKind::kLaterotrusionLeft;
      q.opening_rad = 3 * kDegree * bump(f, 0, 0.32, 0.68, 1);
      (left ? q.slide_right_mm : q.slide_left_mm) = laterotrusion_mm_ * way;
      (left ? q.slide_left_mm : q.slide_right_mm) = 0.3 * way;
      q.side_shift_mm = (left ? 0.9 : -0.9) * way;
      break;
    }
    case JawPhaseKind::kChewing: {
      // A teardrop seen from the front: straight down, out to the chewing side, back into MI.
      const double turn = 2 * M_PI * options_.chewing_cycles * glide(f, 0.12);
      const double way = 0.5 * (1 - std::cos(turn)), side = -std::sin(turn) * way;
      q.opening_rad = chewing_opening_rad_ * way;
      const double working = chewing_slide_mm_ * (way - 0.6 * side);
      const double balancing = chewing_slide_mm_ * (way + 0.6 * side);
      q.slide_left_mm = chewing_side_ > 0 ? working : balancing;
      q.slide_right_mm = chewing_side_ > 0 ? balancing : working;
      q.side_shift_mm = 0.4 * chewing_side_ * side;
      break;
    }
  }
  return pose;
}

const JawPhase& JawSequence::phase_at(double time_s) const {
  const auto after = std::upper_bound(phases_.begin(), phases_.end(), time_s,
                                      [](double t, const JawPhase& p) { return t < p.start_s; });
  return after == phases_.begin() ? phases_.front() : *std::prev(after);
}

Motion<Dental> JawSequence::nominal_motion(double time_s) const {
  const JawPhase& phase = phase_at(time_s);
  const double fraction = std::clamp((time_s - phase.start_s) / phase.duration_s, 0.0, 1.0);
  const Pose pose = pose_in(phase, fraction);
  const Motion<Dental> joints = motion_of(pose.joints, geometry_);
  if (pose.tp == 0) return joints;
  return Motion<Dental>(exp_se3(pose.tp * therapeutic_log_)) * joints;
}

Motion<Dental> JawSequence::mandible_motion(double time_s) const {
  Vector6 xi = Vector6::Zero();
  for (const Tremor& line : tremor_)
    xi += std::sin(2 * M_PI * line.frequency_hz * time_s + line.phase_rad) * line.amplitude;
  return Motion<Dental>(exp_se3(xi)) * nominal_motion(time_s);
}

std::vector<JawMark> JawSequence::marks() const {
  // A hand is a little late and lets go a little early: all of the marked time belongs to the hold.
  constexpr double kReactionS = 0.04;
  std::vector<JawMark> marks;
  for (const JawPhase& phase : phases_) {
    if (!phase.marked) continue;
    const double margin = std::min(kReactionS, 0.2 * phase.duration_s);
    marks.push_back({phase.start_s + margin, phase.name, true});
    marks.push_back({phase.end_s() - margin, phase.name, false});
  }
  return marks;
}

HeadMotion::HeadMotion(std::uint64_t seed, double duration_s, double amplitude) {
  Random random(seed, 0x68656164);
  const auto wave = [&](double low_hz, double high_hz, const Vector3& turn, const Vector3& shift) {
    Wave w{random.uniform(low_hz, high_hz), random.uniform(0, 2 * M_PI), Vector6::Zero()};
    w.amplitude << turn, shift;
    w.amplitude *= amplitude;
    waves_.push_back(w);
  };
  for (int i = 0; i < 3; ++i) {  // drift
    const Vector3 turn = random.normal3() * (0.55 * kDegree), shift = random.normal3() * 0.9;
    wave(0.03, 0.13, turn, shift);
  }
  wave(0.22, 0.3, Vector3(random.uniform(0.1, 0.25) * kDegree, 0, 0), Vector3(0, 0.15, 0.45));  // breathing
  for (int i = 0; i < 2; ++i) {                                                                 // unrest
    const Vector3 turn = random.normal3() * (0.04 * kDegree), shift = random.normal3() * 0.06;
    wave(0.6, 1.4, turn, shift);
  }
  const int nods = std::max(1, static_cast<int>(std::lround(duration_s / 3.5)));
  for (int i = 0; i < nods; ++i) {
    Nod nod;
    nod.centre_s = duration_s * (i + random.uniform(0.2, 0.8)) / nods;
    nod.half_width_s = random.uniform(0.5, 0.9);
    const double size = amplitude * random.uniform(0.8, 2.0) * kDegree * (random.below(2) ? 1 : -1);
    nod.rotation_rad = size * Vector3(1, 0.25 * random.normal(), 0.35 * random.normal());
    nods_.push_back(nod);
  }
}

Motion<Dental> HeadMotion::motion(double time_s) const {
  Vector6 xi = Vector6::Zero();
  for (const Wave& w : waves_) xi += std::sin(2 * M_PI * w.frequency_hz * time_s + w.phase_rad) * w.amplitude;
  Vector3 turn = xi.head<3>();
  for (const Nod& nod : nods_) {
    const double u = (time_s - nod.centre_s) / nod.half_width_s;
    if (std::abs(u) < 1) turn += std::pow(1 - u * u, 3) * nod.rotation_rad;  // C2 at its ends
  }
  const Vector3 neck_mm(0, 115, -75);  // about the upper cervical spine
  const Matrix3 rotation = exp_so3(turn);
  return Motion<Dental>(Rigid3{rotation, neck_mm - rotation * neck_mm + xi.tail<3>()});
}

}  // namespace gnathion
