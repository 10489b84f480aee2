#include "phantom/jaw_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kDegree = M_PI / 180;

/// A few degrees open about the hinge axis, up to a millimetre forward and aside.
Motion<Dental> some_therapeutic(std::uint64_t seed) {
  Random random(seed);
  const Vector3 axis(1, random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2));
  const Vector3 shift(random.uniform(-0.8, 0.8), random.uniform(-1.5, 0), random.uniform(-0.6, 0));
  return Motion<Dental>(Rigid3::from_translation(shift) *
                        Rigid3::about_axis(Vector3(0, 92, 36), axis, random.uniform(1.5, 3.0) * kDegree));
}

JawSequence some_sequence(std::uint64_t seed) {
  JawSequenceOptions options;
  options.seed = seed;
  return JawSequence(JawGeometry{}, some_therapeutic(seed), options);
}

const JawPhase& phase_of(const JawSequence& jaw, JawPhaseKind kind) {
  for (const JawPhase& phase : jaw.phases())
    if (phase.kind == kind) return phase;
  throw std::logic_error("no such phase");
}

/// Displacement of a point at the middle of a phase.
Vector3 moved(const JawSequence& jaw, JawPhaseKind kind, const Vector3& p) {
  const JawPhase& phase = phase_of(jaw, kind);
  return jaw.nominal_motion(phase.start_s + 0.5 * phase.duration_s) * p - p;
}

/// Largest change of acceleration over 1 ms, mm/s²: small where the path is C2, hundreds at a kink.
double largest_acceleration_step(double end_s, const std::function<Vector3(double)>& path) {
  constexpr double kStep = 1e-3;
  const auto acceleration = [&](double t) {
    return Vector3((path(t + kStep) - 2 * path(t) + path(t - kStep)) / (kStep * kStep));
  };
  double largest = 0;
  Vector3 before = acceleration(-0.05);
  for (double t = -0.05 + kStep; t < end_s + 0.05; t += kStep) {
    const Vector3 now = acceleration(t);
    largest = std::max(largest, (now - before).norm());
    before = now;
  }
  return largest;
}

TEST(JawMotion, OpeningLowersTheIncisorAndTurnsAboutTheCondyles) {
  JawState state;
  state.opening_rad = 10 * kDegree;
  const JawGeometry g;
  const Motion<Dental> m = motion_of(state, g);
  EXPECT_NEAR((m * g.condyle_left_mm - g.condyle_left_mm).norm(), 0, 1e-12);
  EXPECT_NEAR((m * g.condyle_right_mm - g.condyle_right_mm).norm(), 0, 1e-12);
  EXPECT_LT((m * g.incisal_point_mm).z(), -10);
  EXPECT_NEAR(m.rigid.angle_rad(), 10 * kDegree, 1e-12);
}

TEST(JawMotion, CondylesFollowTheirPaths) {
  JawState state;
  state.slide_right_mm = 8;
  state.side_shift_mm = 0.8;
  const JawGeometry g;
  const Motion<Dental> m = motion_of(state, g);
  const Vector3 left = m * g.condyle_left_mm - g.condyle_left_mm;
  const Vector3 right = m * g.condyle_right_mm - g.condyle_right_mm;
  EXPECT_LT(right.y(), -5) << "the balancing condyle goes forward";
  EXPECT_LT(right.z(), -2) << "and down";
  EXPECT_GT(right.x(), 0.3) << "and inwards";
  EXPECT_LT(std::abs(left.y()) + std::abs(left.z()), 0.3) << "the working condyle stays";
  EXPECT_NEAR(left.x(), 0.8, 0.4) << "but for its Bennett shift";
  EXPECT_GT((m * g.incisal_point_mm).x(), 4) << "and the chin goes to the left";
}

TEST(JawSequence, HoldsAreExactUpToTremor) {
  for (const std::uint64_t seed : {3, 71, 905}) {
    const JawSequence jaw = some_sequence(seed);
    const Motion<Dental> therapeutic = some_therapeutic(seed);
    double tremor = 0;
    int mi = 0, tp = 0;
    for (const JawPhase& phase : jaw.phases()) {
      if (phase.kind != JawPhaseKind::kMi && phase.kind != JawPhaseKind::kTp) continue;
      const bool is_tp = phase.kind == JawPhaseKind::kTp;
      ++(is_tp ? tp : mi);
      if (is_tp) {
        EXPECT_GE(phase.duration_s, 0.8);
      }
      const Rigid3 expected = is_tp ? therapeutic.rigid : Rigid3{};
      for (const double f : {0.0, 0.3, 0.71, 1.0}) {
        const double t = phase.start_s + f * phase.duration_s - (f == 1.0 ? 1e-9 : 0.0);
        EXPECT_LT(difference(jaw.nominal_motion(t).rigid, expected).norm(), 1e-9);
        tremor =
            std::max(tremor, (jaw.mandible_motion(t) * Vector3(0, 0, 0) - expected.translation_mm).norm());
      }
    }
    EXPECT_GE(mi, 4);
    EXPECT_EQ(tp, 2);
    EXPECT_GT(tremor, 0.0005);
    EXPECT_LT(tremor, 0.02);
  }
}

TEST(JawSequence, MiIsHeldAndMarkedBeforeBetweenAndAfterTp) {
  for (const bool border_movements : {true, false}) {
    JawSequenceOptions options;
    options.border_movements = border_movements;
    options.duration_s = border_movements ? 16 : 8;
    const JawSequence jaw(JawGeometry{}, some_therapeutic(4), options);
    EXPECT_NEAR(jaw.duration_s(), options.duration_s, 1e-9);
    std::string order;
    bool pressed = false;
    double last = 0;
    for (const JawMark& mark : jaw.marks()) {
      EXPECT_NE(mark.pressed, pressed) << "presses and releases alternate";
      pressed = mark.pressed;
      EXPECT_GT(mark.time_s, last);
      last = mark.time_s;
      EXPECT_EQ(jaw.phase_at(mark.time_s).name, mark.kind) << "within its hold";
      if (mark.pressed) order += mark.kind + " ";
    }
    EXPECT_FALSE(pressed);
    EXPECT_EQ(order, border_movements ? "MI MI TP MI TP MI " : "MI TP MI TP MI ");
  }
}

TEST(JawSequence, BorderMovementsAreAnatomical) {
  for (const std::uint64_t seed : {1, 12, 2024}) {
    const JawSequence jaw = some_sequence(seed);
    const JawGeometry g;
    const Vector3 incisal = g.incisal_point_mm;
    const JawPhase& opening = phase_of(jaw, JawPhaseKind::kOpening);
    const Motion<Dental> widest = jaw.nominal_motion(opening.start_s + 0.5 * opening.duration_s);
    EXPECT_NEAR(widest.rigid.angle_rad() / kDegree, 25, 0.1);
    const double gape = (widest * incisal - incisal).norm();
    EXPECT_GT(gape, 38);
    EXPECT_LT(gape, 58);
    const double condyle = moved(jaw, JawPhaseKind::kOpening, g.condyle_left_mm).norm();
    EXPECT_GT(condyle, 8);
    EXPECT_LT(condyle, 14);

    const Vector3 protrusion = moved(jaw, JawPhaseKind::kProtrusion, incisal);
    EXPECT_LT(protrusion.y(), -2.5);
    EXPECT_NEAR(protrusion.x(), 0, 0.3);
    const Vector3 left = moved(jaw, JawPhaseKind::kLaterotrusionLeft, incisal);
    const Vector3 right = moved(jaw, JawPhaseKind::kLaterotrusionRight, incisal);
    EXPECT_GT(left.x(), 5);
    EXPECT_LT(right.x(), -5);
    EXPECT_LT(left.x(), 11);
    const Vector3 rest = moved(jaw, JawPhaseKind::kRest, incisal);
    EXPECT_GT(-rest.z(), 2.0);
    EXPECT_LT(-rest.z(), 3.0);
  }
}

TEST(JawSequence, ChewsThreeTimesOnOneSide) {
  const JawSequence jaw = some_sequence(8);
  const JawPhase& chewing = phase_of(jaw, JawPhaseKind::kChewing);
  int closures = 0, cycles = 0;
  double widest = 0, sideways = 0;
  bool open = false;
  for (double t = chewing.start_s; t < chewing.end_s(); t += 0.002) {
    const Vector3 p = jaw.nominal_motion(t) * Vector3(0, 0, 0);
    widest = std::max(widest, -p.z());
    if (std::abs(p.x()) > std::abs(sideways)) sideways = p.x();
    if (!open && p.z() < -5) open = true, ++cycles;
    if (open && p.z() > -0.3) open = false, ++closures;
  }
  EXPECT_EQ(cycles, 3);
  EXPECT_EQ(closures, 3);
  EXPECT_GT(widest, 14);
  EXPECT_LT(widest, 32);
  EXPECT_GT(std::abs(sideways), 1.0);
}

TEST(JawSequence, TeethPartBeforeTheySlide) {
  // Cusps and incisal edges can pass where the jaw has dropped by more than it has moved sideways,
  // up to the height of an overbite (3 mm in front) or a cusp (2 mm behind).
  const Vector3 incisors(0, -1, 0), molar_left(24, 36, 0), molar_right(-24, 36, 0);
  for (const std::uint64_t seed : {2, 33}) {
    const JawSequence jaw = some_sequence(seed);
    for (const JawPhase& phase : jaw.phases()) {
      if (phase.kind == JawPhaseKind::kTp || phase.kind == JawPhaseKind::kTransfer) continue;
      for (double f = 0; f <= 1; f += 0.004) {
        const Motion<Dental> m = jaw.nominal_motion(phase.start_s + f * phase.duration_s);
        for (const Vector3& tooth : {incisors, molar_left, molar_right}) {
          const Vector3 d = m * tooth - tooth;
          const double forward_or_side = std::hypot(d.x(), std::min(d.y(), 0.0));
          const double needed = std::min(0.8 * forward_or_side, tooth.y() < 0 ? 2.4 : 1.6);
          EXPECT_GE(-d.z(), needed - 0.03) << phase.name << " at " << f << ", tooth " << tooth.transpose();
        }
      }
    }
  }
}

TEST(JawSequence, ApproachesTpFromAbove) {
  for (const std::uint64_t seed : {2, 33, 64}) {
    const JawSequence jaw = some_sequence(seed);
    for (const JawPhase& phase : jaw.phases()) {
      if (phase.name != "MI to TP") continue;
      for (const Vector3& tooth : {Vector3(0, -1, 0), Vector3(24, 36, 0), Vector3(-24, 36, 0)})
        for (double f = 0.02; f < 0.99; f += 0.01) {
          const Vector3 tp = some_therapeutic(seed) * tooth - tooth;
          const Vector3 d = jaw.nominal_motion(phase.start_s + f * phase.duration_s) * tooth - tooth;
          EXPECT_LT(d.z(), std::max(0.0, tp.z()) + 0.01) << "never above MI or TP";
          const double aside = std::hypot(d.x(), d.y());
          EXPECT_GE(-d.z(), std::min(0.45 * aside, -tp.z()) - 0.02) << seed << " at " << f;
        }
    }
  }
}

TEST(JawSequence, IsSmoothThroughout) {
  const JawSequence jaw = some_sequence(5);
  const auto incisal = [&](double t) { return Vector3(jaw.nominal_motion(t) * Vector3(0, 0, 0)); };
  EXPECT_LT(largest_acceleration_step(jaw.duration_s(), incisal), 40);
  const auto trembling = [&](double t) { return Vector3(jaw.mandible_motion(t) * Vector3(0, 0, 0)); };
  EXPECT_LT(largest_acceleration_step(jaw.duration_s(), trembling), 50);
}

TEST(JawSequence, SeedDecidesAll) {
  const JawSequence a = some_sequence(5), b = some_sequence(5);
  JawSequenceOptions other;
  other.seed = 6;
  const JawSequence c(JawGeometry{}, some_therapeutic(5), other);
  double apart = 0;
  for (double t = 0; t < 16; t += 0.37) {
    EXPECT_EQ(a.mandible_motion(t).rigid.matrix(), b.mandible_motion(t).rigid.matrix());
    apart = std::max(apart, difference(a.mandible_motion(t).rigid, c.mandible_motion(t).rigid).norm());
  }
  EXPECT_GT(apart, 0.1);
}

TEST(HeadMotion, IsSlowSmallAndSmooth) {
  for (const std::uint64_t seed : {1, 2, 3, 44}) {
    const HeadMotion head(seed, 16);
    double furthest = 0, angle = 0, fastest = 0;
    for (double t = 0; t < 16; t += 0.01) {
      const Rigid3 m = head.motion(t).rigid;
      furthest = std::max(furthest, (m * Vector3(0, 0, 0)).norm());
      angle = std::max(angle, m.angle_rad());
      fastest =
          std::max(fastest, (head.motion(t + 0.01) * Vector3(0, 0, 0) - m * Vector3(0, 0, 0)).norm() / 0.01);
    }
    EXPECT_GT(furthest, 1.5);
    EXPECT_LT(furthest, 16);
    EXPECT_GT(angle, 0.5 * kDegree);
    EXPECT_LT(angle, 6 * kDegree);
    EXPECT_LT(fastest, 40);
    const auto incisal = [&](double t) { return Vector3(head.motion(t) * Vector3(0, 0, 0)); };
    EXPECT_LT(largest_acceleration_step(16, incisal), 10);
  }
  EXPECT_EQ(HeadMotion(9, 16, 0).motion(5).rigid.angle_rad(), 0);
}

}  // namespace
}  // namespace gnathion
