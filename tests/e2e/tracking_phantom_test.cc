// The film of the virtual patient, tracked: poses, reasons and jaw positions against the truth.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "phantom/film.h"
#include "phantom/film_test_scene.h"
#include "tracking/analysis/jaw_analysis.h"
#include "tracking/plateaus.h"
#include "tracking/session_motion.h"

namespace gnathion {
namespace {

constexpr double kDeg = M_PI / 180;

FilmOptions whole_session() {
  FilmOptions options;
  options.seed = 611;
  options.drop_fraction = 0.01;
  return options;
}

struct Tracked {
  PhantomFilm film{film_test::test_scene(), whole_session()};
  SessionMotion session;
  Vector3 incisal_in_bow;
};

/// Filmed and tracked once for all tests of this file.
Tracked& tracked() {
  static Tracked* const shared = [] {
    auto* t = new Tracked;
    SilentProgress progress;
    auto session = track_session(t->film, t->film.scene().rig, {}, progress);
    EXPECT_TRUE(session.has_value()) << session.error().line();
    if (session) t->session = std::move(*session);
    t->incisal_in_bow = t->film.scene().bow_from_dental * t->film.scene().incisal_point_mm;
    return t;
  }();
  return *shared;
}

Rigid3 true_head_from_bow(const FilmTruth& truth) {
  return truth.camera_from_head.rigid.inverse() * truth.camera_from_bow.rigid;
}

TEST(TrackingPhantom, EveryFrameTakenHasARow) {
  Tracked& t = tracked();
  EXPECT_EQ(t.session.rows.size(), t.film.frames_per_camera());
  std::size_t missing = 0;
  for (std::size_t i = 0; i < t.session.rows.size(); ++i) {
    const MotionRow& row = t.session.rows[i];
    EXPECT_EQ(row.sequence, t.session.rows.front().sequence + i);
    EXPECT_LE(std::abs(row.capture.seconds_since(t.film.capture_time(static_cast<std::uint32_t>(i)))), 1e-4);
    if (row.cameras > 0) continue;
    ++missing;
    EXPECT_EQ(row.reason(), "missing: counter gap");
  }
  EXPECT_GT(missing, 0u);
  EXPECT_EQ(missing, t.session.ledger.at("camera_0").missing);
}

TEST(TrackingPhantom, TheBowRelativeToTheHeadIsTrueToFiveHundredths) {
  Tracked& t = tracked();
  double squares_mm2 = 0, squares_rad2 = 0, normalised = 0;
  int valid = 0, delivered = 0;
  for (const MotionRow& row : t.session.rows) {
    if (row.cameras == 0) continue;
    ++delivered;
    if (!row.valid()) continue;
    ++valid;
    const Rigid3 truth = true_head_from_bow(t.film.truth_at(row.capture)), found = row.head_from_bow().rigid;
    squares_mm2 += (found * t.incisal_in_bow - truth * t.incisal_in_bow).squaredNorm();
    squares_rad2 += std::pow((found.inverse() * truth).angle_rad(), 2);
    const Vector6 xi = difference(truth, found);
    normalised += xi.dot(row.head_from_bow_covariance().ldlt().solve(xi)) / 6;
  }
  EXPECT_GE(valid, delivered * 99 / 100);
  const double rms_mm = std::sqrt(squares_mm2 / valid), rms_deg = std::sqrt(squares_rad2 / valid) / kDeg;
  std::printf("single frames: incisal point %.4f mm, %.4f deg RMS; normalised error squared / 6 = %.2f\n",
              rms_mm, rms_deg, normalised / valid);
  EXPECT_LE(rms_mm, 0.05);
  EXPECT_LE(rms_deg, 0.05);
  EXPECT_GE(normalised / valid, 0.7);
  EXPECT_LE(normalised / valid, 1.4);
}

/// The therapeutic motion that the positions give by the camera route, with the true T_D.
void expect_therapeutic(const PlateauOptions& options, double limit_mm) {
  Tracked& t = tracked();
  const auto positions = find_jaw_positions(t.session, options);
  ASSERT_TRUE(positions.has_value()) << positions.error().line();
  const FilmScene& scene = t.film.scene();
  const auto dental_from_camera = dental_from_measurement(scene.bow_from_dental, positions->at_mi);
  const Motion<Dental> therapeutic = express_in(dental_from_camera, positions->bow_motion.value);
  double worst_mm = 0;
  for (const Vector3& tooth : {Vector3(0, 0, 0), Vector3(25, 35, 0), Vector3(-25, 35, 0)}) {
    worst_mm = std::max(worst_mm, (therapeutic * tooth - scene.therapeutic * tooth).norm());
  }
  const double off_deg = (therapeutic.rigid.inverse() * scene.therapeutic.rigid).angle_rad() / kDeg;
  std::printf("T_th by the camera route: %.4f mm at the worst tooth, %.4f deg; %zu MI, %zu TP\n", worst_mm,
              off_deg, positions->mi.size(), positions->tp.size());
  EXPECT_LE(worst_mm, limit_mm);
  EXPECT_LE(off_deg, 0.02);
  EXPECT_TRUE(positions->closes());
  const Vector3 opened = therapeutic * Vector3(0, 0, 0);
  EXPECT_LT(opened.z(), 0) << "opening moves the incisal point away from the maxilla";
}

TEST(TrackingPhantom, MarkedPlateausGiveTheTherapeuticMotion) {
  PlateauOptions options;
  options.point_in_bow_mm = tracked().incisal_in_bow;
  expect_therapeutic(options, 0.02);
}

TEST(TrackingPhantom, GivenIntervalsGiveItToo) {
  PlateauOptions options;
  options.point_in_bow_mm = tracked().incisal_in_bow;
  for (const JawPhase& phase : tracked().film.jaw().phases()) {
    const PlateauOptions::Interval inside(phase.start_s + 0.05, phase.end_s() - 0.05);
    if (phase.kind == JawPhaseKind::kMi) options.mi_s.push_back(inside);
    if (phase.kind == JawPhaseKind::kTp) options.tp_s.push_back(inside);
  }
  expect_therapeutic(options, 0.02);
}

TEST(TrackingPhantom, RestsAreFoundWhereTheJawRests) {
  PlateauOptions options;
  options.point_in_bow_mm = tracked().incisal_in_bow;
  const auto rests = find_rests(tracked().session, options);
  EXPECT_GE(rests.size(), 5u);
  for (const Plateau& rest : rests) {
    const JawPhaseKind kind = tracked().film.jaw().phase_at(0.5 * (rest.start_s + rest.end_s)).kind;
    EXPECT_TRUE(kind == JawPhaseKind::kMi || kind == JawPhaseKind::kTp || kind == JawPhaseKind::kRest ||
                kind == JawPhaseKind::kTransfer || kind == JawPhaseKind::kProtrusion)
        << rest.start_s << ".." << rest.end_s;
  }
}

/// Chord of a condyle's true path in the protrusion, 1 kHz, dental axes x left, y back, z up.
double true_inclination_deg(const PhantomFilm& film, const Vector3& condyle_mm, double chord_mm) {
  for (const JawPhase& phase : film.jaw().phases()) {
    if (phase.kind != JawPhaseKind::kProtrusion) continue;
    for (double t = phase.start_s; t < phase.end_s(); t += 1e-3) {
      const Vector3 d = film.jaw().nominal_motion(t) * condyle_mm - condyle_mm;
      if (std::hypot(d.y(), d.z()) >= chord_mm) return std::atan2(-d.z(), -d.y()) / kDeg;
    }
  }
  return NAN;
}

TEST(TrackingPhantom, TheMotionIsReadAsTheJointsMoved) {
  Tracked& t = tracked();
  const FilmScene& scene = t.film.scene();
  PlateauOptions options;
  options.point_in_bow_mm = t.incisal_in_bow;
  const auto mi = find_mi(t.session, options);
  ASSERT_TRUE(mi.has_value()) << mi.error().line();
  const auto recording =
      jaw_recording(t.session, mi->head_from_bow_mi, {scene.bow_from_dental, Matrix6::Zero()});
  ASSERT_TRUE(recording.has_value()) << recording.error().line();
  JawLandmarks landmarks;
  landmarks.molar_left_mm = {23, 30, 0};
  landmarks.molar_right_mm = {-23, 30, 0};
  landmarks.condyle_left_mm = scene.condyle_left_mm;
  landmarks.condyle_right_mm = scene.condyle_right_mm;
  const auto a = analyse_jaw_motion(*recording, landmarks, {});
  ASSERT_TRUE(a.has_value()) << a.error().line();
  for (const bool left : {true, false}) {
    const JawNumber* n = a->find("sagittal_condylar_inclination_5mm", left ? "left" : "right");
    ASSERT_TRUE(n != nullptr && n->determined) << n->reason;
    const double truth =
        true_inclination_deg(t.film, left ? scene.condyle_left_mm : scene.condyle_right_mm, 5);
    std::printf("inclination %s by the film: %.2f deg, stated sigma %.2f, truth %.2f\n", n->side.c_str(),
                n->value, n->sigma, truth);
    EXPECT_NEAR(n->value, truth, std::max(4 * n->sigma, 0.2));
    EXPECT_LE(n->sigma, 1.0);
  }
  const JawNumber* angle = a->find("opening_angle");
  ASSERT_TRUE(angle->determined);
  EXPECT_NEAR(angle->value, 25, std::max(4 * angle->sigma, 0.05));
  EXPECT_EQ(a->find("chewing_cycles")->value, 3);
}

}  // namespace
}  // namespace gnathion
