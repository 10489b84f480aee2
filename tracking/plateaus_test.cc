#include "tracking/plateaus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"
#include "tracking/motion_file.h"
#include "tracking/se3_mean.h"
#include "tracking/slip.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;

constexpr double kRate_hz = 60;
const Vector3 kIncisal(0, 5, 60);

/// A jaw session without images: MI 0.5..1.5 s, TP 3..4, MI 6..7; a moving head; noise as one camera has it.
struct Scripted {
  Rigid3 mi{exp_so3(Vector3(0.1, -0.2, 0.05)), Vector3(3, 70, 20)};
  Rigid3 tp;
  SessionMotion session;
};

Matrix6 noise_of(double sigma_rad, double sigma_mm, const Vector3& at_mm) {
  Matrix6 cov = Matrix6::Zero();
  cov.topLeftCorner<3, 3>() = Matrix3::Identity() * sigma_rad * sigma_rad;
  cov.bottomRightCorner<3, 3>() = Vector3(1, 1, 16).asDiagonal() * (sigma_mm * sigma_mm);
  const Matrix6 ad = adjoint(Rigid3::from_translation(at_mm));
  return ad * cov * ad.transpose();
}

Rigid3 jaw_at(const Scripted& s, double t) {
  const auto blend = [](const Rigid3& a, const Rigid3& b, double f) {
    const double smooth = f * f * (3 - 2 * f);
    return exp_se3(difference(b, a) * smooth) * a;
  };
  const Rigid3 open = Rigid3::about_axis(Vector3(0, 40, -90), Vector3::UnitX(), 0.2) * s.mi;
  if (t < 0.4) return blend(open, s.mi, t / 0.4);
  if (t < 1.6) return s.mi;
  if (t < 2.2) return blend(s.mi, open, (t - 1.6) / 0.6);
  if (t < 2.8) return blend(open, s.tp, (t - 2.2) / 0.6);
  if (t < 4.2) return s.tp;
  if (t < 5.8) return blend(s.tp, s.mi, (t - 4.2) / 1.6);
  return s.mi;
}

/// `slip_mm` of the bow after 4.2 s; `head_slip_mm` of the head frame at 5.0 s; `still_mm`: shared error of
/// each of the rests, as the floor of the options has it.
Scripted scripted(std::uint64_t seed, double slip_mm = 0, double head_slip_mm = 0,
                  const Matrix6* shared = nullptr) {
  Scripted s;
  s.tp = Rigid3::about_axis(Vector3(0, 40, -90), Vector3(1, 0.1, 0), 0.06) *
         Rigid3::from_translation({0.3, 0, -0.8}) * s.mi;
  Random random(seed);
  const Matrix6 cov_bow = noise_of(1e-4, 0.006, Vector3(0, 60, 400)),
                cov_head = noise_of(1e-4, 0.006, Vector3(0, 0, 400));
  const Matrix6 l_bow = Eigen::LLT<Matrix6>(cov_bow).matrixL(),
                l_head = Eigen::LLT<Matrix6>(cov_head).matrixL();
  const auto normal6 = [&] {
    Vector6 v;
    for (int i = 0; i < 6; ++i) v[i] = random.normal();
    return v;
  };
  Vector6 rest_error[3] = {Vector6::Zero(), Vector6::Zero(), Vector6::Zero()};
  if (shared != nullptr) {
    const Matrix6 l = Eigen::LLT<Matrix6>(*shared).matrixL();
    for (Vector6& e : rest_error) e = l * normal6();
  }
  for (int i = 0; i < 7.2 * kRate_hz; ++i) {
    const double t = i / kRate_hz;
    MotionRow row;
    row.sequence = static_cast<std::uint32_t>(i);
    row.capture.ns = static_cast<std::int64_t>(t * 1e9);
    row.cameras = 1;
    const Rigid3 head{exp_so3(Vector3(0.03 * std::sin(t), 0.02 * t, 0)),
                      Vector3(5 * std::sin(0.7 * t), 0, 400 + t)};
    Rigid3 relative = jaw_at(s, t);
    if (t > 4.2) relative = relative * Rigid3::from_translation({0, slip_mm, 0});
    Rigid3 frame = head;
    if (t > 5.0) frame = head * Rigid3::from_translation({0, head_slip_mm, 0.3 * head_slip_mm});
    row.head.camera_from_body = exp_se3(l_head * normal6()) * frame;
    row.bow.camera_from_body = exp_se3(l_bow * normal6()) * head *
                               exp_se3(rest_error[t < 2   ? 0
                                                  : t < 5 ? 1
                                                          : 2]) *
                               relative;
    row.head.covariance = cov_head;
    row.bow.covariance = cov_bow;
    row.head.valid = row.bow.valid = true;
    if (i % 37 == 5) {  // now and then a frame is blind
      row.bow.valid = false;
      row.bow.reason = "no tag seen";
    }
    s.session.rows.push_back(row);
  }
  return s;
}

void press(SessionMotion* session, const char* kind, double from_s, double to_s) {
  for (const auto& [at, pressed] : {std::pair(from_s, true), std::pair(to_s, false)}) {
    EventSample e;
    e.header.capture.ns = static_cast<std::int64_t>(at * 1e9);
    e.kind = kind;
    e.pressed = pressed;
    session->events.push_back(e);
  }
}

PlateauOptions no_floor() {
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  options.floor_mm = options.floor_deg = 1e-6;
  return options;
}

/// T_B as it truly is, in the camera frame at MI as estimated.
Motion<Camera> true_motion(const Scripted& s, const JawPositions& p) {
  const Rigid3& h = p.at_mi.f_from_head.rigid;
  return Motion<Camera>(h * s.tp * s.mi.inverse() * h.inverse());
}

TEST(RobustMean, OfSymmetricErrorsIsTheCentreAndOutliersDoNotMoveIt) {
  Random random(1);
  const Rigid3 truth{random.rotation(), Vector3(30, -20, 400)};
  std::vector<Rigid3> poses;
  for (int i = 0; i < 20; ++i) {
    Vector6 xi;
    for (int k = 0; k < 6; ++k) xi[k] = 1e-3 * random.normal();
    poses.push_back(exp_se3(xi) * truth);
    poses.push_back(exp_se3(Vector6(-xi)) * truth);
  }
  const PoseMean clean = robust_mean(poses);
  EXPECT_LE((clean.mean * Vector3(0, 0, 50) - truth * Vector3(0, 0, 50)).norm(), 0.15);
  for (int i = 0; i < 6; ++i) poses.push_back(Rigid3::from_translation({5, 5, 5}) * truth);
  const PoseMean soiled = robust_mean(poses);
  EXPECT_LE((soiled.mean * Vector3(0, 0, 50) - clean.mean * Vector3(0, 0, 50)).norm(), 0.05);
  EXPECT_EQ(soiled.used, clean.used);
}

TEST(RobustMean, CorrelatedSamplesCountLess) {
  Random random(2);
  std::vector<Rigid3> white, red;
  Vector6 state = Vector6::Zero();
  for (int i = 0; i < 400; ++i) {
    Vector6 e;
    for (int k = 0; k < 6; ++k) e[k] = 1e-3 * random.normal();
    white.push_back(exp_se3(e));
    state = 0.8 * state + 0.6 * e;
    red.push_back(exp_se3(state));
  }
  EXPECT_GE(robust_mean(white).effective_count, 280);
  EXPECT_LE(robust_mean(red).effective_count, 100);  // (1 − 0.8)/(1 + 0.8)·400 = 44
}

TEST(JawPositions, FromPedalMarksAreTrueTo20Micrometres) {
  double squares = 0, squares_rad = 0, nees = 0;
  const int runs = 60;
  for (int i = 0; i < runs; ++i) {
    Scripted s = scripted(static_cast<std::uint64_t>(500 + i));
    press(&s.session, "MI", 0.5, 1.5);
    press(&s.session, "TP", 3.0, 4.0);
    press(&s.session, "MI", 6.0, 7.0);
    const auto p = find_jaw_positions(s.session, no_floor());
    ASSERT_TRUE(p.has_value()) << p.error().line();
    EXPECT_EQ(p->mi.size(), 2u);
    EXPECT_TRUE(p->closes());
    const Motion<Camera> truth = true_motion(s, *p);
    const Vector3 incisal = p->at_mi.f_from_bow * kIncisal;
    squares += (p->bow_motion.value * incisal - truth * incisal).squaredNorm();
    squares_rad += std::pow((p->bow_motion.value.rigid.inverse() * truth.rigid).angle_rad(), 2);
    const Vector6 xi = difference(truth.rigid, p->bow_motion.value.rigid);
    nees += xi.dot(p->bow_motion.covariance.ldlt().solve(xi)) / 6 / runs;
  }
  std::printf("T_B from plateaus of 1 s: %.4f mm, %.4f deg RMS at the incisal point; NEES/6 %.2f\n",
              std::sqrt(squares / runs), std::sqrt(squares_rad / runs) * 180 / M_PI, nees);
  EXPECT_LE(std::sqrt(squares / runs), 0.02);
  EXPECT_LE(std::sqrt(squares_rad / runs) * 180 / M_PI, 0.02);
  EXPECT_GE(nees, 0.7);
  EXPECT_LE(nees, 1.4);
}

/// The bar: plateaus of 0.5 s, errors of calibration shared by all frames of a rest (drawn as large as the
/// options say), 200 seeds. Coverage of the 95 % ellipsoid: χ² of 6 below 12.59.
TEST(JawPositions, FromHalfASecondAreTrueTo15MicrometresAndSayHowTrue) {
  double squares = 0, squares_deg = 0, nees = 0;
  int covered = 0;
  const int runs = 200;
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  options.mi_s = {{0.55, 1.05}, {6.2, 6.7}};
  options.tp_s = {{3.1, 3.6}};
  options.trim_s = 0;
  Matrix6 at_point = Matrix6::Zero();
  at_point.diagonal() << Vector3::Constant(std::pow(options.floor_deg * M_PI / 180, 2)),
      Vector3::Constant(options.floor_mm * options.floor_mm);
  const Vector3 teeth = scripted(1).mi * kIncisal;
  const Matrix6 ad = adjoint(Rigid3::from_translation(teeth));
  const Matrix6 shared = ad * at_point * ad.transpose();
  for (int i = 0; i < runs; ++i) {
    const Scripted s = scripted(static_cast<std::uint64_t>(31000 + i), 0, 0, &shared);
    const auto p = find_jaw_positions(s.session, options);
    ASSERT_TRUE(p.has_value()) << p.error().line();
    const Motion<Camera> truth = true_motion(s, *p);
    const Vector3 incisal = p->at_mi.f_from_bow * kIncisal;
    squares += (p->bow_motion.value * incisal - truth * incisal).squaredNorm() / runs;
    squares_deg +=
        std::pow((p->bow_motion.value.rigid.inverse() * truth.rigid).angle_rad() * 180 / M_PI, 2) / runs;
    const Vector6 xi = difference(truth.rigid, p->bow_motion.value.rigid);
    const double square = xi.dot(p->bow_motion.covariance.ldlt().solve(xi));
    nees += square / 6 / runs;
    covered += square <= 12.59;
  }
  std::printf("T_B from plateaus of 0.5 s, %d seeds: %.4f mm, %.4f deg RMS; NEES/6 %.2f, covered %.1f %%\n",
              runs, std::sqrt(squares), std::sqrt(squares_deg), nees, 100.0 * covered / runs);
  EXPECT_LE(std::sqrt(squares), 0.015);
  EXPECT_LE(std::sqrt(squares_deg), 0.015);
  EXPECT_GE(nees, 0.8);
  EXPECT_LE(nees, 1.25);
  EXPECT_GE(covered, 0.90 * runs);
  EXPECT_LE(covered, 0.98 * runs);
}

TEST(JawPositions, BowMotionIsRelativeMotionOfTheTwoAndOpeningMovesAway) {
  Scripted s = scripted(3);
  PlateauOptions options = no_floor();
  options.mi_s = {{0.5, 1.5}};
  options.tp_s = {{3.0, 4.0}};
  const auto p = find_jaw_positions(s.session, options);
  ASSERT_TRUE(p.has_value());
  const Motion<Camera> again = relative_motion(p->at_mi, p->at_tp);
  EXPECT_LE((again.rigid.matrix() - p->bow_motion.value.rigid.matrix()).norm(), 1e-12);
  EXPECT_EQ(p->mi.front().source, "given");
}

TEST(JawPositions, AreFoundWithoutMarks) {
  Scripted s = scripted(4);
  const auto p = find_jaw_positions(s.session, no_floor());
  ASSERT_TRUE(p.has_value()) << p.error().line();
  EXPECT_EQ(p->mi.size(), 2u);
  ASSERT_EQ(p->tp.size(), 1u);
  EXPECT_EQ(p->notes.size(), 2u);
  const Motion<Camera> truth = true_motion(s, *p);
  const Vector3 incisal = p->at_mi.f_from_bow * kIncisal;
  EXPECT_LE((p->bow_motion.value * incisal - truth * incisal).norm(), 0.05);
}

TEST(JawPositions, OneGlitchInAMarkMovesItsMeanAndItsTypicalDistanceLittle) {
  Scripted s = scripted(71);
  press(&s.session, "MI", 0.6, 1.4);
  press(&s.session, "TP", 3.0, 4.0);
  for (MotionRow& row : s.session.rows)
    if (row.valid() && row.capture.ns > 1'000'000'000) {
      row.bow.camera_from_body = row.bow.camera_from_body * Rigid3::from_translation({0, 5, 0});
      break;
    }
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  const auto found = find_jaw_positions(s.session, options);
  ASSERT_TRUE(found) << found.error().line();
  EXPECT_GT(found->mi.front().dispersion_mm, 0.3);
  EXPECT_LT(found->mi.front().typical_mm, 0.1);
  EXPECT_LT((found->head_from_bow_mi.value * kIncisal - s.mi * kIncisal).norm(), 0.02);
}

TEST(JawPositions, AreFoundWithASlowCamera) {
  Scripted s = scripted(72);
  std::vector<MotionRow> slow;  // 15 frames a second
  for (std::size_t i = 0; i < s.session.rows.size(); i += 4) slow.push_back(s.session.rows[i]);
  s.session.rows = slow;
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  const auto found = find_jaw_positions(s.session, options);
  ASSERT_TRUE(found) << found.error().line();
  EXPECT_LT((found->head_from_bow_mi.value * kIncisal - s.mi * kIncisal).norm(), 0.05);
  EXPECT_LT((found->head_from_bow_tp.value * kIncisal - s.tp * kIncisal).norm(), 0.05);
}

TEST(JawPositions, MiIsNotLookedForWhereTpWasMarked) {
  // TP is rested at twice as often as MI; only it is marked.
  Scripted s = scripted(73);
  for (MotionRow& row : s.session.rows) {
    const double t = static_cast<double>(row.capture.ns) * 1e-9;
    if (t > 5.8 && row.valid())
      row.bow.camera_from_body = row.head.camera_from_body * s.tp;
  }
  press(&s.session, "TP", 3.0, 4.0);
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  const auto found = find_jaw_positions(s.session, options);
  ASSERT_TRUE(found) << found.error().line();
  EXPECT_LT((found->head_from_bow_mi.value * kIncisal - s.mi * kIncisal).norm(), 0.05);
}

TEST(JawPositions, ASlippedBowDoesNotClose) {
  Scripted s = scripted(5, 0.15);
  press(&s.session, "MI", 0.5, 1.5);
  press(&s.session, "TP", 3.0, 4.0);
  press(&s.session, "MI", 6.0, 7.0);
  const auto p = find_jaw_positions(s.session, no_floor());
  ASSERT_TRUE(p.has_value());
  ASSERT_EQ(p->closures.size(), 1u);
  EXPECT_FALSE(p->closes());
  EXPECT_NEAR(p->closures[0].distance_mm, 0.15, 0.03);
  EXPECT_THAT(p->notes.back(), HasSubstr("slipped"));
}

TEST(JawPositions, ASlipIsToldApart) {
  PlateauOptions options;
  options.point_in_bow_mm = kIncisal;
  int head_told = 0, bow_told = 0, wrong = 0;
  const int runs = 12;
  for (int i = 0; i < runs; ++i) {
    for (const bool of_head : {true, false}) {
      Scripted s = scripted(static_cast<std::uint64_t>(800 + i), of_head ? 0 : 0.6, of_head ? 0.6 : 0);
      press(&s.session, "MI", 0.5, 1.5);
      press(&s.session, "TP", 3.0, 4.0);
      press(&s.session, "MI", 6.0, 7.0);
      const auto p = find_jaw_positions(s.session, options);
      ASSERT_TRUE(p.has_value());
      EXPECT_FALSE(p->closes());
      const auto slips = find_slips(s.session, *p, options);
      ASSERT_EQ(slips.size(), 1u);
      EXPECT_EQ(slips[0].before, 0u);
      EXPECT_EQ(slips[0].after, 1u);
      const SlipCause right = of_head ? SlipCause::kHeadFrame : SlipCause::kBow;
      (of_head ? head_told : bow_told) += slips[0].cause == right;
      wrong += slips[0].cause != right && slips[0].cause != SlipCause::kNotTold;
      if (of_head && slips[0].seen) {
        EXPECT_NEAR(slips[0].at_s, 5.0, 0.1);
      }
    }
  }
  std::printf("slips of 0.6 mm told: head frame %d, bow %d of %d each; wrong %d\n", head_told, bow_told, runs,
              wrong);
  EXPECT_GE(head_told, runs - 1);
  EXPECT_GE(bow_told, runs - 1);
  EXPECT_EQ(wrong, 0);
  // Nobody saw the head frame while it happened: not told.
  Scripted s = scripted(850, 0, 0.6);
  for (auto& row : s.session.rows)
    if (std::abs(s.session.time_s(row) - 5.0) < 0.4) row.head.valid = false, row.head.reason = "no tag seen";
  press(&s.session, "MI", 0.5, 1.5);
  press(&s.session, "TP", 3.0, 4.0);
  press(&s.session, "MI", 6.0, 7.0);
  const auto p = find_jaw_positions(s.session, options);
  ASSERT_TRUE(p.has_value());
  const auto slips = find_slips(s.session, *p, options);
  ASSERT_EQ(slips.size(), 1u);
  EXPECT_EQ(slips[0].cause, SlipCause::kNotTold);
  EXPECT_THAT(slips[0].why, HasSubstr("not seen"));
}

TEST(JawPositions, MiAloneAndRanks) {
  Scripted s = scripted(9);
  press(&s.session, "MI", 0.5, 0.8);
  press(&s.session, "MI", 6.0, 7.0);
  const auto p = find_mi(s.session, no_floor());
  ASSERT_TRUE(p.has_value());
  ASSERT_EQ(p->mi.size(), 2u);
  EXPECT_EQ(p->mi[0].rank, 2);  // shorter, so less sure
  EXPECT_EQ(p->mi[1].rank, 1);
  EXPECT_TRUE(p->tp.empty());
}

TEST(JawPositions, AreRefusedWithAReasonWhereThereAreNone) {
  SessionMotion empty;
  auto p = find_jaw_positions(empty, {});
  ASSERT_FALSE(p.has_value());
  EXPECT_EQ(p.error().code, ErrorCode::kInput);
  Scripted s = scripted(6);
  for (auto& row : s.session.rows) {
    if (s.session.time_s(row) < 2) row.head.valid = false, row.head.reason = "1 tag, need 2";
  }
  press(&s.session, "MI", 0.5, 1.5);
  press(&s.session, "TP", 3.0, 4.0);
  p = find_jaw_positions(s.session, {});
  ASSERT_FALSE(p.has_value());
  EXPECT_THAT(p.error().line(), HasSubstr("1 tag, need 2"));
}

TEST(MotionFile, TellsTheMandiblesMotionInTheDentalFrame) {
  Scripted s = scripted(7);
  const Transform<Bow, Dental> bow_from_dental(Rigid3{exp_so3(Vector3(1.2, 0.3, -0.4)), kIncisal});
  const JawMotion motion = jaw_motion(s.session, Transform<HeadFrame, Bow>(s.mi), bow_from_dental);
  ASSERT_EQ(motion.rows.size(), s.session.rows.size());
  EXPECT_EQ(motion.frame, "dental");
  const Rigid3 t_d = bow_from_dental.rigid;
  const Rigid3 therapeutic = t_d.inverse() * s.mi.inverse() * s.tp * t_d;  // the camera route's T_th
  int compared = 0;
  for (const JawMotionRow& row : motion.rows) {
    if (!row.valid || row.time_s < 3 || row.time_s > 4) continue;
    ++compared;
    EXPECT_LE((row.motion * Vector3::Zero() - therapeutic * Vector3::Zero()).norm(), 0.3);
    EXPECT_GT(row.sigma_mm, 0.005);
    EXPECT_LT(row.sigma_mm, 0.2);
  }
  EXPECT_GE(compared, 50);
}

TEST(MotionFile, RoundTrips) {
  Scripted s = scripted(8);
  s.session.rows[3].head.valid = false;
  s.session.rows[3].head.reason = "2 tags, need 3, \"glare\"";
  for (const bool dental : {true, false}) {
    const auto t_d =
        dental ? std::optional(Transform<Bow, Dental>(Rigid3::from_translation(kIncisal))) : std::nullopt;
    const JawMotion motion = jaw_motion(s.session, Transform<HeadFrame, Bow>(s.mi), t_d);
    const auto again = parse_motion_csv(format_motion_csv(motion), "motion.csv");
    ASSERT_TRUE(again.has_value()) << again.error().line();
    EXPECT_EQ(again->frame, dental ? "dental" : "head_frame");
    ASSERT_EQ(again->rows.size(), motion.rows.size());
    EXPECT_THAT(again->rows[3].reason, HasSubstr("\"glare\""));
    for (std::size_t i = 0; i < motion.rows.size(); ++i) {
      const JawMotionRow &a = motion.rows[i], &b = again->rows[i];
      ASSERT_EQ(a.valid, b.valid);
      EXPECT_NEAR(a.time_s, b.time_s, 1e-6);
      if (a.valid) {
        EXPECT_LE((a.motion.matrix() - b.motion.matrix()).norm(), 3e-6);
      }
    }
  }
}

TEST(MotionFile, BadFilesAreRefusedWithTheirLine) {
  const std::string header = "time_s,valid,reason,x_mm,y_mm,z_mm,qw,qx,qy,qz,sigma_mm\n";
  const auto why = [](const std::string& text) {
    const auto read = parse_motion_csv(text, "m.csv");
    return read ? std::string() : read.error().line();
  };
  EXPECT_THAT(why(""), HasSubstr("no header"));
  EXPECT_THAT(why("a,b\n1,2\n"), HasSubstr("line 1"));
  EXPECT_THAT(why(header + "0,1,,1,2,3,1,0,0\n"), HasSubstr("line 2"));
  EXPECT_THAT(why(header + "0,1,,1,2,nan,1,0,0,0,0.1\n"), HasSubstr("not a number"));
  EXPECT_THAT(why(header + "0,1,,1,2,3,1,1,0,0,0.1\n"), HasSubstr("quaternion"));
  EXPECT_EQ(why(header + "0,1,,1,2,3,1,0,0,0,0.1\n"), "");
}

}  // namespace
}  // namespace gnathion
