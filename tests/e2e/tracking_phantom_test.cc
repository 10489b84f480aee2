// The film of the virtual patient, tracked: poses, reasons and jaw positions against the truth.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "phantom/film.h"
#include "phantom/film_test_scene.h"
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

}  // namespace
}  // namespace gnathion
