// The electromagnetic route, whole: a Polhemus recording of the virtual patient's session → motion.mcap →
// T_th, and the same motion read as clinicians read it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "acquisition/recording.h"
#include "core/file.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "phantom/jaw_motion.h"
#include "pipeline/motion_analysis.h"
#include "pipeline/motion_steps.h"
#include "pipeline/therapeutic_steps.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
constexpr double kDegree = M_PI / 180, kRate_hz = 120, kSigma_mm = 0.05, kSigma_deg = 0.02;

struct Patient {
  JawGeometry geometry;
  Motion<Dental> therapeutic;
  Rigid3 bow_from_dental{exp_so3(Vector3(1.2, 0.3, -0.4)), Vector3(0, 5, 60)};
  Rigid3 head_from_dental{exp_so3(Vector3(0.3, 0, 0.1)), Vector3(10, 60, 80)};
  Rigid3 bow_from_sensor{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  JawSequenceOptions options;
};

Patient patient_of(std::uint64_t seed) {
  Patient p;
  p.therapeutic = Motion<Dental>(motion_of({0.05, 1.0, 1.2, 0.2}, p.geometry));
  p.options.seed = seed;
  p.options.duration_s = 20;
  return p;
}

/// Sensor 1 on the bow, 2 and 3 on the head; metal near for half a second; readings that fail or are lost;
/// pedal marks.
void record(const Patient& p, std::uint64_t seed, const fs::path& path) {
  const JawSequence jaw(p.geometry, p.therapeutic, p.options);
  const HeadMotion head(seed, jaw.duration_s());
  const Rigid3 transmitter_from_dental{exp_so3(Vector3(0.1, 0.4, -0.2)), Vector3(150, 40, -220)};
  Random random(seed, 5);
  auto writer = RecordingWriter::create(path, {});
  ASSERT_TRUE(writer.has_value()) << writer.error().line();
  const auto marks = jaw.marks();
  std::size_t next_mark = 0;
  for (int i = 0; i < jaw.duration_s() * kRate_hz; ++i) {
    const double t = i / kRate_hz;
    for (; next_mark < marks.size() && marks[next_mark].time_s <= t; ++next_mark) {
      EventSample e;
      e.header.stream = "pedal";
      e.header.sequence = static_cast<std::uint32_t>(next_mark);
      e.header.capture.ns = e.header.arrival.ns = static_cast<std::int64_t>(marks[next_mark].time_s * 1e9);
      e.kind = marks[next_mark].kind;
      e.pressed = marks[next_mark].pressed;
      ASSERT_TRUE(writer->write(e).has_value());
    }
    const Rigid3 maxilla = transmitter_from_dental * head.motion(t).rigid;
    for (int sensor = 1; sensor <= 3; ++sensor) {
      Rigid3 truth = maxilla * p.head_from_dental.inverse();
      if (sensor == 1)
        truth = maxilla * jaw.mandible_motion(t).rigid * p.bow_from_dental.inverse() * p.bow_from_sensor;
      if (sensor == 3) truth = truth * Rigid3::from_translation({-60, 0, 15});
      if (sensor == 3 && t > 6.0 && t < 6.5) truth.translation_mm += Vector3(1.2, 0, 0.6);
      PoseSample s;
      s.header.stream = "em/" + std::to_string(sensor);
      s.header.sequence = static_cast<std::uint32_t>(i);
      s.header.capture.ns = s.header.arrival.ns = static_cast<std::int64_t>(t * 1e9);
      s.reference = "transmitter";
      s.body = "sensor_" + std::to_string(sensor);
      s.reference_from_body.rotation = exp_so3(kSigma_deg * kDegree * random.normal3()) * truth.rotation;
      s.reference_from_body.translation_mm = truth.translation_mm + kSigma_mm * random.normal3();
      s.valid = !(sensor == 1 && i % 211 == 17);
      if (!s.valid) s.reason = "source failed in xy";
      if (sensor == 2 && i % 173 == 40) continue;
      ASSERT_TRUE(writer->write(s).has_value());
    }
  }
  ASSERT_TRUE(writer->finish().has_value());
}

fs::path folder_of(const char* name) {
  const fs::path folder = fs::path(::testing::TempDir()) / name;
  fs::remove_all(folder);
  fs::create_directories(folder);
  return folder;
}

/// electromagnetic.toml with the true mount.
void write_setup(const Patient& p, const fs::path& path) {
  std::string numbers;
  const Matrix4 m = p.bow_from_sensor.matrix();
  for (int i = 0; i < 16; ++i) {
    char text[40];
    std::snprintf(text, sizeof text, "%s%.17g", i ? ", " : "", m(i / 4, i % 4));
    numbers += text;
  }
  ASSERT_TRUE(
      write_file(path,
                 "[bow]\nstream = \"em/1\"\nbody_from_sensor = [" + numbers +
                     "]\n[head]\nstream = \"em/2\"\n[[rigid_pair]]\nfirst = \"em/2\"\nsecond = \"em/3\"\n")
          .has_value());
}

Result<SessionMotion> session_through_files(const Patient& p, std::uint64_t seed, const fs::path& folder,
                                            std::vector<Distortion>* distortions) {
  record(p, seed, folder / "em.mcap");
  write_setup(p, folder / "em.toml");
  GNATHION_TRY(const ElectromagneticSetup setup, read_electromagnetic(folder / "em.toml"));
  GNATHION_TRY(const ElectromagneticMotion m, track_electromagnetic(folder / "em.mcap", setup));
  *distortions = m.distortions;
  GNATHION_TRY(const SmoothedMotion smoothed, smooth_motion(m.session, {}));
  GNATHION_CHECK_OK(write_poses(folder / "motion.mcap", to_pose_recording(m.session, &smoothed), {}));
  GNATHION_TRY(const PoseRecording poses, read_poses(folder / "motion.mcap"));
  const auto channel = poses.bodies.find("bow_smoothed");
  if (channel == poses.bodies.end() || channel->second.front().parent != "head_frame")
    return fail(ErrorCode::kInternal, "test", "motion.mcap", "has no smoothed channel");
  return to_session_motion(poses, "motion.mcap");
}

TEST(ElectromagneticRoute, GivesTherapeuticFromARecording) {
  double squares = 0, nees = 0;
  const int runs = 6;
  for (int i = 0; i < runs; ++i) {
    const std::uint64_t seed = 60 + static_cast<std::uint64_t>(i);
    const fs::path folder = folder_of("electromagnetic_route");
    const Patient p = patient_of(seed);
    std::vector<Distortion> distortions;
    const auto session = session_through_files(p, seed, folder, &distortions);
    ASSERT_TRUE(session.has_value()) << session.error().line();
    ASSERT_EQ(distortions.size(), 1u);
    EXPECT_NEAR(distortions[0].start_s, 6.0, 0.03);
    EXPECT_NEAR(distortions[0].end_s, 6.5, 0.03);
    ChainPose t_d;
    t_d.value = p.bow_from_dental;
    t_d.covariance.diagonal() << Vector3::Constant(1e-10), Vector3::Constant(1e-8);
    const auto route = camera_route(*session, t_d, {});
    ASSERT_TRUE(route.has_value()) << route.error().line();
    EXPECT_TRUE(route->positions.closes());
    const Rigid3& found = route->estimate.therapeutic.value.rigid;
    squares += (found * Vector3::Zero() - p.therapeutic.rigid * Vector3::Zero()).squaredNorm() / runs;
    const Vector6 xi = difference(p.therapeutic.rigid, found);
    nees += xi.dot(route->estimate.therapeutic.covariance.ldlt().solve(xi)) / 6 / runs;
  }
  std::printf(
      "T_th by electromagnetic poses of %.2f mm, %.2f deg noise: %.4f mm RMS at the teeth, NEES/6 %.2f\n",
      kSigma_mm, kSigma_deg, std::sqrt(squares), nees);
  // 0.05 mm and 0.02 deg (0.03 mm at 85 mm), about 90 readings a rest, two rests each: about 0.012 mm.
  EXPECT_LE(std::sqrt(squares), 0.03);
  EXPECT_LE(nees, 2.0);
}

TEST(ElectromagneticRoute, MotionIsReadAsCliniciansReadIt) {
  const fs::path folder = folder_of("electromagnetic_analysis");
  const Patient p = patient_of(90);
  std::vector<Distortion> distortions;
  const auto session = session_through_files(p, 90, folder, &distortions);
  ASSERT_TRUE(session.has_value()) << session.error().line();
  const auto pose = [](const Rigid3& r) {
    return nlohmann::json{{"matrix", matrix_json(r.matrix())},
                          {"covariance", covariance_json(1e-8 * Matrix6::Identity())},
                          {"rms_mm", 0.01},
                          {"held_out_mm", 0.01},
                          {"condition", 1.0},
                          {"weak", nlohmann::json::array()}};
  };
  ASSERT_TRUE(write_json(folder / "chain.json", {{"bow_from_dental", pose(p.bow_from_dental)}}).has_value());
  ASSERT_TRUE(
      write_file(folder / "landmarks.toml",
                 "incisal_mm = [0, 0, 0]\nmolar_left_mm = [23, 30, 0]\nmolar_right_mm = [-23, 30, 0]\n"
                 "condyle_left_mm = [50, 92, 36]\ncondyle_right_mm = [-50, 92, 36]\n")
          .has_value());
  MotionAnalysisJob job;
  job.motion = folder / "motion.mcap";
  job.calibration = folder / "chain.json";
  job.landmarks = folder / "landmarks.toml";
  SilentProgress silent;
  const auto m = analyse_motion(job, silent);
  ASSERT_TRUE(m.has_value()) << m.error().line();
  const JawNumber* inclination = m->analysis.find("sagittal_condylar_inclination_5mm", "left");
  ASSERT_TRUE(inclination != nullptr && inclination->determined) << inclination->reason;
  // Chord of the path at 5 mm: slope 0.66 rad at first, flattened by 0.025·sin per mm.
  const double s = 5, drop = s * std::sin(0.66) - 0.025 * std::sin(0.66) * s * s;
  EXPECT_NEAR(inclination->value, std::atan2(drop, s * std::cos(0.66)) / kDegree, 1.5);
  EXPECT_NEAR(m->analysis.find("opening_angle")->value, 25, 0.2);
  EXPECT_FALSE(m->analysis.hinge.has_value());  // a free opening: the condyles slide
  EXPECT_THAT(m->analysis.hinge_reason, HasSubstr("guided"));
  ASSERT_TRUE(write_motion_analysis(*m, job, folder).has_value());
  for (const char* file : {"analysis.json", "numbers.csv", "paths.csv", "chewing.csv", "settings.csv",
                           "pictures/incisal.png", "pictures/condyles.svg", "pictures/hinge_axis.png",
                           "pictures/chewing.png", "pictures/jaw-motion.pdf"})
    EXPECT_TRUE(fs::exists(folder / file)) << file;
  // Another bow's chain, landmarks of nowhere, and no chain at all: refused by name, never a number.
  const Rigid3 other{exp_so3(Vector3(0.2, 2.3, 1.4)), Vector3(90, -70, 20)};
  ASSERT_TRUE(write_json(folder / "chain.json", {{"bow_from_dental", pose(other)}}).has_value());
  const auto wrong = analyse_motion(job, silent);
  ASSERT_FALSE(wrong.has_value());
  EXPECT_THAT(wrong.error().line(), HasSubstr("another bow"));
  ASSERT_TRUE(
      write_file(
          folder / "landmarks.toml",
          "incisal_mm = [0, 0, 0]\nmolar_left_mm = [0.023, 0.03, 0]\nmolar_right_mm = [-0.023, 0.03, 0]\n")
          .has_value());
  EXPECT_FALSE(analyse_motion(job, silent).has_value());
}

}  // namespace
}  // namespace gnathion
