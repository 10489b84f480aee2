#include "tracking/electromagnetic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include <Eigen/Cholesky>

#include "core/angle.h"
#include "core/random.h"
#include "tracking/list_source.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;
using testing::ListSource;
constexpr double kRate_hz = 120;

/// A head with two sensors (2 and 3) and a bow with one (1) that opens and closes, six seconds.
struct Scene {
  Rigid3 bow_from_sensor{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  Rigid3 head_3_from_2{exp_so3(Vector3(0.1, 0.2, 0)), Vector3(60, 5, -12)};
  double sigma_mm = 0.05, sigma_deg = 0.02;
  double metal_from_s = 0, metal_to_s = 0, metal_mm = 0, metal_deg = 0;  ///< bends sensor 3's readings
  double scale = 1;                                                      ///< 0.001: metres
  Rigid3 transmitter_from_head(double t) const {
    return {exp_so3(Vector3(0.2 + 0.03 * std::sin(t), 0.1, 0.02 * t)),
            Vector3(80 + 4 * std::sin(0.7 * t), 200, -60)};
  }
  Rigid3 head_from_bow(double t) const {
    const double way = t < 2 || t > 4 ? 0 : 0.5 * (1 - std::cos(M_PI * (t - 2)));
    return Rigid3::about_axis({0, 40, -90}, Vector3::UnitX(), 0.3 * way) *
           Rigid3{exp_so3(Vector3(0.1, 0, 0)), Vector3(3, 70, 20)};
  }

  std::vector<Sample> samples(std::uint64_t seed) const {
    Random random(seed);
    std::vector<Sample> all;
    for (int i = 0; i < 6 * kRate_hz; ++i) {
      const double t = i / kRate_hz;
      const Rigid3 head = transmitter_from_head(t);
      for (int sensor = 1; sensor <= 3; ++sensor) {
        Rigid3 truth = head;
        if (sensor == 1) truth = head * head_from_bow(t) * bow_from_sensor;
        if (sensor == 3) truth = head * head_3_from_2.inverse();
        PoseSample s;
        s.header.stream = "em/" + std::to_string(sensor);
        s.header.sequence = static_cast<std::uint32_t>(i);
        s.header.capture.ns = 5'000'000'000LL + static_cast<std::int64_t>(t * 1e9);
        s.reference = "transmitter";
        if (sensor == 3 && t >= metal_from_s && t < metal_to_s)
          truth = {truth.rotation * exp_so3(Vector3(metal_deg * kRadPerDeg, 0, 0)),
                   truth.translation_mm + metal_mm * truth.rotation.col(0)};
        s.reference_from_body.rotation = exp_so3(sigma_deg * kRadPerDeg * random.normal3()) * truth.rotation;
        s.reference_from_body.translation_mm = scale * (truth.translation_mm + sigma_mm * random.normal3());
        s.valid = !(sensor == 1 && i % 97 == 50);
        if (!s.valid) s.reason = "source failed in xy";
        if (sensor == 2 && i % 89 == 30) continue;  // lost between tracker and host
        all.emplace_back(std::move(s));
      }
    }
    return all;
  }
  ElectromagneticSetup setup() const {
    ElectromagneticSetup s;
    s.bow = {"em/1", {bow_from_sensor, Matrix6::Zero()}};
    s.head = {"em/2", {}};
    s.pairs = {{"em/2", "em/3"}};
    return s;
  }
};

Result<ElectromagneticMotion> tracked(const Scene& scene, const ElectromagneticSetup& setup,
                                      std::uint64_t seed = 1) {
  ListSource source(scene.samples(seed));
  return electromagnetic_motion(source, setup);
}

TEST(Electromagnetic, GivesTheBowInTheHeadFrameWithItsError) {
  const Scene scene;
  const auto m = tracked(scene, scene.setup());
  ASSERT_TRUE(m.has_value()) << m.error().line();
  EXPECT_NEAR(m->sigma_mm, scene.sigma_mm, 0.25 * scene.sigma_mm);
  EXPECT_NEAR(m->sigma_deg, scene.sigma_deg, 0.25 * scene.sigma_deg);
  EXPECT_TRUE(m->distortions.empty());
  ASSERT_EQ(m->session.rows.size(), static_cast<std::size_t>(6 * kRate_hz));
  double nees = 0, n = 0, lost = 0;
  for (const MotionRow& row : m->session.rows) {
    if (!row.valid()) {
      EXPECT_FALSE(row.reason().empty());
      ++lost;
      continue;
    }
    const Rigid3 truth = scene.head_from_bow(m->session.time_s(row));
    const Vector6 xi = difference(truth, row.head_from_bow().rigid);
    nees += xi.dot(row.head_from_bow_covariance().ldlt().solve(xi)) / 6;
    n += 1;
  }
  EXPECT_EQ(lost, 7 + 8);  // 50, 147 … of the bow; 30, 119 … of the head
  EXPECT_GE(nees / n, 0.7);
  EXPECT_LE(nees / n, 1.4);
}

// As a recording tells it: the line comes with the time of the reading after the gap.
TEST(Electromagnetic, LostReadingsStandBetweenTheirNeighbours) {
  const Scene scene;
  std::vector<Sample> samples;
  for (Sample& sample : scene.samples(8)) {
    const PoseSample& pose = std::get<PoseSample>(sample);
    const bool bow = pose.header.stream == "em/1";
    if (bow && (pose.header.sequence == 200 || pose.header.sequence == 201)) continue;
    if (bow && pose.header.sequence == 202) {
      LedgerSample told;
      told.header = pose.header;
      told.header.sequence = 200;
      told.count = 2;
      told.fate = LedgerSample::Fate::kMissing;
      told.reason = "counter gap";
      samples.emplace_back(told);
    }
    samples.push_back(std::move(sample));
  }
  ListSource source(std::move(samples));
  const auto m = electromagnetic_motion(source, scene.setup());
  ASSERT_TRUE(m.has_value()) << m.error().line();
  ASSERT_EQ(m->session.rows.size(), static_cast<std::size_t>(6 * kRate_hz));
  for (const std::size_t i : {199u, 200u, 201u, 202u}) {
    const MotionRow& row = m->session.rows[i];
    EXPECT_EQ(row.valid(), i == 199 || i == 202) << i << ": " << row.reason();
    EXPECT_NEAR(m->session.time_s(row), static_cast<double>(i) / kRate_hz, 1e-4);
  }
}

TEST(Electromagnetic, MetalIsNamedWithTimeAndPlaceAndItsRowsAreNotValid) {
  for (const bool shift : {true, false}) {
    Scene scene;
    scene.metal_from_s = 2.5;
    scene.metal_to_s = 3.1;
    (shift ? scene.metal_mm : scene.metal_deg) = 1.5;
    const auto m = tracked(scene, scene.setup(), 3);
    ASSERT_TRUE(m.has_value()) << m.error().line();
    ASSERT_EQ(m->distortions.size(), 1u) << shift;
    const Distortion& d = m->distortions[0];
    EXPECT_NEAR(d.start_s, 2.5, 0.02);
    EXPECT_NEAR(d.end_s, 3.1, 0.02);
    EXPECT_LE((d.where_mm - scene.transmitter_from_head(2.8).translation_mm).norm(), 5);
    EXPECT_THAT(d.text(), HasSubstr("metal"));
    for (const MotionRow& row : m->session.rows) {
      const double t = m->session.time_s(row);
      if (t > 2.52 && t < 3.08) {
        EXPECT_FALSE(row.valid());
        EXPECT_THAT(row.reason(), HasSubstr("metal"));
      }
    }
  }
}

TEST(Electromagnetic, BadRecordingsAreRefusedByName) {
  Scene scene;
  ElectromagneticSetup setup = scene.setup();
  setup.bow.stream = "em/7";
  auto m = tracked(scene, setup);
  ASSERT_FALSE(m.has_value());
  EXPECT_THAT(m.error().line(), HasSubstr("em/7"));
  EXPECT_THAT(m.error().line(), HasSubstr("em/1"));  // what there is
  setup = scene.setup();
  setup.head.stream = "em/1";
  EXPECT_FALSE(tracked(scene, setup).has_value());
  setup = scene.setup();
  setup.pairs = {{"em/1", "em/2"}};  // bow and head are not one body
  m = tracked(scene, setup);
  ASSERT_TRUE(m.has_value());
  EXPECT_FALSE(m->distortions.empty());
  Scene metres;
  metres.scale = 0.001;
  m = tracked(metres, metres.setup());
  ASSERT_FALSE(m.has_value());
  EXPECT_THAT(m.error().line(), HasSubstr("metres"));
}

/// A bow turned by hand before a camera and a tracker, about all axes or about one.
std::vector<SensorPair> calibration_pairs(std::uint64_t seed, bool one_axis, const Rigid3& x, double sigma_mm,
                                          double sigma_deg) {
  Random random(seed);
  const Rigid3 camera_from_transmitter{exp_so3(Vector3(1, 0.5, -0.4)), Vector3(-200, 100, 600)};
  Matrix6 camera = Matrix6::Zero();
  camera.diagonal() << Vector3::Constant(1e-8), Vector3(4e-5, 4e-5, 1e-3);
  std::vector<SensorPair> pairs;
  for (int i = 0; i < 120; ++i) {
    const double a = 2 * M_PI * i / 120;
    const Vector3 turn = one_axis
                             ? Vector3(0.6 * std::sin(a), 0, 0)
                             : Vector3(0.6 * std::sin(a), 0.5 * std::sin(2 * a + 1), 0.5 * std::cos(3 * a));
    const Rigid3 m{exp_so3(turn), Vector3(20 * std::sin(a), 15 * std::cos(a), 400)};
    SensorPair p;
    const Matrix6 ad = adjoint(Rigid3::from_translation(m.translation_mm));
    p.camera_covariance = ad * camera * ad.transpose();
    Vector6 e;
    for (int k = 0; k < 6; ++k) e[k] = random.normal();
    p.camera_from_bow = exp_se3(Matrix6(Eigen::LLT<Matrix6>(p.camera_covariance).matrixL()) * e) * m;
    const Rigid3 s = camera_from_transmitter.inverse() * m * x;
    p.transmitter_from_sensor = {s.rotation * exp_so3(sigma_deg * kRadPerDeg * random.normal3()),
                                 s.translation_mm + sigma_mm * random.normal3()};
    pairs.push_back(p);
  }
  return pairs;
}

TEST(SensorCalibration, ByCamerasIsTrueAndSaysHowTrue) {
  const Rigid3 x{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  double nees = 0, mm2 = 0;
  int covered = 0;
  const int runs = 60;
  for (int i = 0; i < runs; ++i) {
    const auto c = calibrate_sensor(
        calibration_pairs(static_cast<std::uint64_t>(5000 + i), false, x, 0.3, 0.1), 0.3, 0.1);
    ASSERT_TRUE(c.has_value()) << c.error().line();
    EXPECT_TRUE(c->weak.empty());
    EXPECT_NEAR(c->held_out_mm, c->rms_mm, 0.3 * c->rms_mm);
    const Vector6 xi = difference(x, c->bow_from_sensor.value);
    const double square = xi.dot(c->bow_from_sensor.covariance.ldlt().solve(xi));
    nees += square / 6 / runs;
    covered += square <= 12.59;
    mm2 += (x.translation_mm - c->bow_from_sensor.value.translation_mm).squaredNorm() / runs;
  }
  std::printf("sensor on the bow: %.3f mm RMS, NEES/6 %.2f, covered %d of %d\n", std::sqrt(mm2), nees,
              covered, runs);
  EXPECT_LE(std::sqrt(mm2), 0.3);
  EXPECT_GE(nees, 0.7);
  EXPECT_LE(nees, 1.35);
  EXPECT_GE(covered, static_cast<int>(0.87 * runs));
}

TEST(SensorCalibration, NamesWhatOneAxisDoesNotTell) {
  const Rigid3 x{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  const auto c = calibrate_sensor(calibration_pairs(1, true, x, 0.3, 0.1), 0.3, 0.1);
  ASSERT_TRUE(c.has_value());
  ASSERT_FALSE(c->weak.empty());
  EXPECT_THAT(c->weak.back(), HasSubstr("(1.00, 0.00, 0.00)"));
  EXPECT_THAT(c->weak.back(), HasSubstr("weak"));
}

TEST(SensorCalibration, RefusesWhatCannotBe) {
  const Rigid3 x{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  auto pairs = calibration_pairs(1, false, x, 0.3, 0.1);
  auto loose = pairs;
  for (std::size_t i = 60; i < loose.size(); ++i)
    loose[i].transmitter_from_sensor.rotation =
        loose[i].transmitter_from_sensor.rotation * exp_so3({0.5, 0.5, 0});
  EXPECT_FALSE(calibrate_sensor(loose, 0.3, 0.1).has_value());
  std::vector<SensorPair> still(20, pairs[0]);
  const auto c = calibrate_sensor(still, 0.3, 0.1);
  ASSERT_FALSE(c.has_value());
  EXPECT_THAT(c.error().line(), HasSubstr("turn"));
  pairs.resize(4);
  EXPECT_FALSE(calibrate_sensor(pairs, 0.3, 0.1).has_value());
}

TEST(SensorCalibration, ByDigitisedPoints) {
  const Rigid3 x{exp_so3(Vector3(0.4, -0.3, 0.8)), Vector3(12, -30, 8)};
  const std::vector<Vector3> in_bow = {{0, 0, 0},   {60, 5, 0},     {-55, 8, 3},
                                       {4, 40, 20}, {-20, 30, -15}, {25, -10, 12}};
  double nees = 0;
  const int runs = 200;
  for (int i = 0; i < runs; ++i) {
    Random random(static_cast<std::uint64_t>(900 + i));
    std::vector<Vector3> in_sensor;
    for (const Vector3& p : in_bow) in_sensor.push_back(x.inverse() * p + 0.2 * random.normal3());
    const auto c = calibrate_sensor_by_points(in_bow, in_sensor);
    ASSERT_TRUE(c.has_value());
    const Vector6 xi = difference(x, c->bow_from_sensor.value);
    nees += xi.dot(c->bow_from_sensor.covariance.ldlt().solve(xi)) / 6 / runs;
  }
  // The variance itself comes from 12 residuals: the mean of F(6, 12) is 1.2.
  EXPECT_GE(nees, 0.9);
  EXPECT_LE(nees, 1.5);
  const std::vector<Vector3> line = {{0, 0, 0}, {10, 0, 0}, {20, 0, 0}, {30, 0, 0}};
  EXPECT_FALSE(calibrate_sensor_by_points(line, line).has_value());
  EXPECT_FALSE(calibrate_sensor_by_points(in_bow, {in_bow.begin(), in_bow.begin() + 3}).has_value());
  auto swapped = in_bow;
  std::swap(swapped[0], swapped[1]);
  EXPECT_FALSE(calibrate_sensor_by_points(in_bow, swapped).has_value());
}

}  // namespace
}  // namespace gnathion
