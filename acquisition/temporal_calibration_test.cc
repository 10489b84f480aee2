#include "acquisition/temporal_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

#include "core/random.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;
constexpr double kDeg = M_PI / 180;
using Motion = std::function<Rigid3(double t_s)>;

/// Openings of different depth and speed, some sideways, with rests between: reference_from_body at any time.
Motion jaw_motion(std::uint64_t seed) {
  struct Stroke {
    double begin_s, length_s, opening_deg, lateral_deg;
  };
  Random random(seed);
  std::vector<Stroke> strokes;
  for (double t = -3; t < 20; t += 0.1) {
    const double length = random.uniform(0.5, 1.3);
    strokes.push_back({t, length, random.uniform(8, 30), random.uniform(-4, 4)});
    t += length + (random.uniform() < 0.3 ? random.uniform(0, 0.5) : 0);
  }
  return [strokes](double t) {
    double opening = 0, lateral = 0;
    for (const Stroke& s : strokes) {
      const double u = (t - s.begin_s) / s.length_s;
      if (u <= 0 || u >= 1) continue;
      const double bump = std::pow(std::sin(M_PI * u), 2);
      opening += s.opening_deg * bump;
      lateral += s.lateral_deg * bump * std::sin(2 * M_PI * u);
    }
    const Rigid3 hinge = Rigid3::about_axis({0, -10, 80}, {1, 0, 0}, opening * kDeg);
    return Rigid3::about_axis({0, 0, 60}, {0, 1, 0}, lateral * kDeg) * hinge;
  };
}

struct Sensor {
  double rate_hz = 60, noise_deg = 0.05, noise_mm = 0.05;
  double lost = 0.05;          ///< share of samples that are not there
  double gap_s = 0.4;          ///< and one gap
  double time_noise_s = 1e-4;  ///< of the capture times
};

/// What a sensor says of ten seconds of the motion, in frames of its own, with its times shifted.
std::vector<TimedPose> seen(const Motion& motion, const Sensor& sensor, double shift_s, Random* random,
                            double seconds = 10) {
  const Rigid3 outer{random->rotation(), 500 * random->normal3()},
      inner{random->rotation(), 50 * random->normal3()};
  const double gap = random->uniform(2, seconds - 2), phase = random->uniform(0, 1 / sensor.rate_hz);
  std::vector<TimedPose> poses;
  for (double t = phase; t < seconds; t += 1 / sensor.rate_hz) {
    if (random->uniform() < sensor.lost || (t > gap && t < gap + sensor.gap_s)) continue;
    Vector6 noise;
    noise << sensor.noise_deg * kDeg * random->normal3(), sensor.noise_mm * random->normal3();
    const double stamp_s = t + shift_s + sensor.time_noise_s * random->normal();
    poses.push_back({{1'700'000'000'000'000'000 + std::llround(stamp_s * 1e9)},
                     outer * motion(t) * inner * exp_se3(noise)});
  }
  return poses;
}

TEST(TemporalCalibration, FindsTheOffsetToAMillisecondFromTenSeconds) {
  Random random(90210);
  double worst_ms = 0, sum = 0, chi = 0;
  constexpr int kTrials = 40;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Motion motion = jaw_motion(random.next_u32());
    Sensor camera, tracker;
    tracker.rate_hz = trial % 2 ? 240 : 120;
    tracker.noise_deg = 0.1;
    const double offset_s = random.uniform(-0.8, 0.8);
    const auto a = seen(motion, camera, 0, &random);
    const auto b = seen(motion, tracker, -offset_s, &random);
    const auto found = calibrate_time_offset(a, b);
    ASSERT_TRUE(found) << found.error().line();
    const double error_s = found->offset_s - offset_s;
    worst_ms = std::max(worst_ms, std::abs(error_s) * 1e3);
    sum += error_s * error_s;
    chi += std::pow(error_s / found->sigma_s, 2);
    EXPECT_GT(found->correlation, found->runner_up);
  }
  std::printf("40 trials: worst %.3f ms, rms %.3f ms, rms error over sigma %.2f\n", worst_ms,
              1e3 * std::sqrt(sum / kTrials), std::sqrt(chi / kTrials));
  EXPECT_LT(worst_ms, 1.0);
  // The sigma tells the truth, within a factor.
  EXPECT_GT(std::sqrt(chi / kTrials), 0.5);
  EXPECT_LT(std::sqrt(chi / kTrials), 2.0);
}

TEST(TemporalCalibration, ACameraOfTwentyFiveHertzNeedsALittleMore) {
  Random random(5150);
  double worst_ms = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const Motion motion = jaw_motion(random.next_u32());
    Sensor camera, tracker;
    camera.rate_hz = 25;
    tracker.rate_hz = 240;
    const double offset_s = random.uniform(-0.5, 0.5);
    const auto found = calibrate_time_offset(seen(motion, camera, 0, &random, 18),
                                             seen(motion, tracker, -offset_s, &random, 18));
    ASSERT_TRUE(found) << found.error().line();
    worst_ms = std::max(worst_ms, std::abs(found->offset_s - offset_s) * 1e3);
  }
  std::printf("25 Hz: worst %.3f ms\n", worst_ms);
  EXPECT_LT(worst_ms, 1.0);
}

TEST(TemporalCalibration, ScalarsWithAnotherGainAndBias) {
  Random random(11);
  for (int trial = 0; trial < 10; ++trial) {
    const Motion motion = jaw_motion(random.next_u32());
    const double offset_s = random.uniform(-0.5, 0.5);
    std::vector<TimedValue> a, b;
    for (double t = 0; t < 10; t += 1 / 60.0)
      a.push_back({{std::llround(t * 1e9)}, motion(t).angle_rad() + 1e-3 * random.normal()});
    for (double t = 0; t < 10; t += 1 / 137.0)
      b.push_back(
          {{std::llround((t - offset_s) * 1e9)}, 5 - 3 * motion(t).angle_rad() + 3e-3 * random.normal()});
    const auto found = calibrate_time_offset(a, b);
    ASSERT_TRUE(found) << found.error().line();
    EXPECT_NEAR(found->offset_s, offset_s, 1e-3);
  }
}

/// Why a motion does not do; empty where an offset was found all the same.
std::string refusal(const Motion& motion_a, const Motion& motion_b, std::uint64_t seed, double seconds = 10,
                    Sensor sensor = {}) {
  Random random(seed);
  Sensor faster = sensor;
  faster.rate_hz = 240;
  const auto found = calibrate_time_offset(seen(motion_a, sensor, 0, &random, seconds),
                                           seen(motion_b, faster, 0.123, &random, seconds));
  if (found) return "";
  EXPECT_EQ(found.error().code, ErrorCode::kGate);
  return found.error().line();
}

TEST(TemporalCalibration, SaysWhenTheMotionDoesNotDetermineIt) {
  const Motion still = [](double) { return Rigid3::identity(); };
  const Motion even = [](double t) { return Rigid3::about_axis({0, 0, 0}, {1, 0, 0}, t); };
  const Motion slow = [](double t) {
    return Rigid3::about_axis({0, 0, 0}, {1, 0, 0}, 0.3 * kDeg * std::sin(0.7 * t) * std::cos(0.31 * t));
  };
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const std::string says = "the motion does not determine the offset";
    EXPECT_THAT(refusal(still, still, seed), HasSubstr(says));
    EXPECT_THAT(refusal(even, even, seed), HasSubstr(says));
    EXPECT_THAT(refusal(slow, slow, seed), HasSubstr(says));
    EXPECT_THAT(refusal(jaw_motion(seed), jaw_motion(seed + 100), seed), HasSubstr(says));
    EXPECT_THAT(refusal(jaw_motion(seed), jaw_motion(seed), seed, 4.9), HasSubstr(says));
    // Periodic, with less and more noise, and none: several offsets fit alike.
    for (const double period_s : {0.4, 0.73, 0.9}) {
      const Motion periodic = [period_s](double t) {
        const double u = 2 * M_PI * t / period_s;
        return Rigid3::about_axis({0, 0, 0}, {1, 0, 0},
                                  15 * kDeg * (std::sin(u) + 0.3 * std::sin(2 * u + 1)));
      };
      for (const double noise_deg : {0.0, 0.02, 0.2}) {
        Sensor sensor;
        sensor.noise_deg = noise_deg;
        EXPECT_THAT(refusal(periodic, periodic, seed, 10, sensor), HasSubstr(says))
            << period_s << " " << noise_deg;
      }
    }
  }
  std::printf("  %s\n", refusal(still, still, 1).c_str());
  std::printf("  %s\n", refusal(even, even, 1).c_str());
  std::printf("  %s\n", refusal(jaw_motion(1), jaw_motion(1), 1, 4.9).c_str());
}

TEST(TemporalCalibration, AnOffsetBeyondTheSearchIsNotFoundElsewhere) {
  Random random(17);
  for (int trial = 0; trial < 10; ++trial) {
    const Motion motion = jaw_motion(random.next_u32());
    const auto found =
        calibrate_time_offset(seen(motion, {}, 0, &random, 12), seen(motion, {}, 1.7, &random, 12));
    EXPECT_FALSE(found) << found->offset_s << " " << found->correlation;
  }
}

TEST(TemporalCalibration, TakesAnyOrderAndRepeatedSamples) {
  Random random(23);
  const Motion motion = jaw_motion(1);
  const auto a = seen(motion, {}, 0, &random), b = seen(motion, {}, -0.2, &random);
  auto shuffled = b;
  for (std::size_t i = shuffled.size(); i > 1; --i)
    std::swap(shuffled[i - 1], shuffled[random.below(static_cast<std::uint32_t>(i))]);
  shuffled.push_back(shuffled.front());
  const auto x = calibrate_time_offset(a, b), y = calibrate_time_offset(a, shuffled);
  ASSERT_TRUE(x && y);
  EXPECT_EQ(x->offset_s, y->offset_s);
  EXPECT_NEAR(x->offset_s, 0.2, 1e-3);
  EXPECT_FALSE(calibrate_time_offset(std::vector<TimedPose>{}, b));
}

}  // namespace
}  // namespace gnathion
