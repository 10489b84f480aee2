#include "acquisition/clock_estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "core/random.h"

namespace gnathion {
namespace {

/// A device's clock and its transport, with the truth.
struct SimulatedDevice {
  SimulatedDevice(std::uint64_t seed, double rate, double drift)
      : random(seed), rate_hz(rate), drift_ppm(drift) {
    device_start_ns = static_cast<std::int64_t>(random.uniform(0, 5000) * 1e9);
  }
  struct Pair {
    DeviceTime device;
    HostTime arrival;
    HostTime truth;  ///< of the device's instant, on the host's clock
  };
  /// The pair `elapsed_s` of host time after the start.
  Pair at(double elapsed_s) {
    const HostTime truth{host_start_ns + std::llround(elapsed_s * 1e9)};
    // Rare heavy tail over a plain one, and 5 % that a busy host took 50 ms too late.
    double late_ms = -std::log(1 - random.uniform()) * jitter_ms;
    if (random.uniform() < 0.1) late_ms += std::min(40.0, std::pow(1 - random.uniform(), -1 / 1.5) - 1);
    if (random.uniform() < outlier_share) late_ms += 50;
    HostTime arrival{truth.ns + latency_ns + std::llround(late_ms * 1e6)};
    if (in_order) arrival.ns = last_arrival_ns = std::max(arrival.ns, last_arrival_ns);
    const double device_s = elapsed_s / (1 + drift_ppm * 1e-6);
    return {{device_start_ns + std::llround(device_s * 1e9)}, arrival, truth};
  }
  Random random;
  double rate_hz, drift_ppm;
  double jitter_ms = 0.5, outlier_share = 0.05;
  bool in_order = true;  ///< what comes after a late one is not earlier than it
  std::int64_t last_arrival_ns = 0;
  std::int64_t latency_ns = 7'000'000, device_start_ns = 0, host_start_ns = 1'700'000'000'000'000'000;
};

double error_ms(HostTime a, HostTime b) {
  return 1e-6 * static_cast<double>(a.ns - b.ns);
}

struct Worst {
  double early_ms = 0, settled_ms = 0, rms_ms = 0, drift_ppm = 0;
};

/// Two minutes of one device; errors of the capture times beyond the constant latency that cannot be seen.
Worst run(SimulatedDevice device) {
  ClockEstimator::Options options;
  options.latency_ns = device.latency_ns;
  ClockEstimator clock(options);
  Worst worst;
  double sum = 0;
  std::int64_t last_ns = INT64_MIN;
  int settled = 0;
  for (double t = 0; t < 120; t += 1 / device.rate_hz) {
    const auto pair = device.at(t);
    const HostTime host = clock.add(pair.device, pair.arrival);
    if (pair.arrival.ns > last_ns) {  // what overtakes a late one may be earlier than it
      EXPECT_GT(host.ns, last_ns);
    }
    EXPECT_LE(host.ns, pair.arrival.ns);
    last_ns = host.ns;
    const double e = error_ms(host, pair.truth);
    if (t < 5) {
      // The very first arrivals may all be late ones; from half a second on there is something to follow.
      if (t > 0.5) worst.early_ms = std::max(worst.early_ms, std::abs(e));
      continue;
    }
    worst.settled_ms = std::max(worst.settled_ms, std::abs(e));
    sum += e * e;
    ++settled;
  }
  worst.rms_ms = std::sqrt(sum / settled);
  worst.drift_ppm = std::abs(clock.estimate().drift_ppm - device.drift_ppm);
  EXPECT_EQ(clock.estimate().restarts, 0u);
  return worst;
}

TEST(ClockEstimator, FollowsDriftThroughHeavyTailsAndOutliers) {
  Random seeds(20240611);
  Worst all;
  for (int i = 0; i < 40; ++i) {
    const double rates_hz[] = {25, 60, 120, 240};
    SimulatedDevice device(seeds.next_u32(), rates_hz[i % 4], seeds.uniform(-200, 200));
    device.in_order = i % 8 < 4;
    const Worst w = run(device);
    all.early_ms = std::max(all.early_ms, w.early_ms);
    all.settled_ms = std::max(all.settled_ms, w.settled_ms);
    all.rms_ms = std::max(all.rms_ms, w.rms_ms);
    all.drift_ppm = std::max(all.drift_ppm, w.drift_ppm);
  }
  std::printf("worst of 40: from 0.5 s %.3f ms, from 5 s %.3f ms, rms %.3f ms, drift off by %.2f ppm\n",
              all.early_ms, all.settled_ms, all.rms_ms, all.drift_ppm);
  EXPECT_LT(all.early_ms, 1.0);
  EXPECT_LT(all.settled_ms, 0.25);
  EXPECT_LT(all.rms_ms, 0.1);
  EXPECT_LT(all.drift_ppm, 10);
}

TEST(ClockEstimator, ABurstAtTheStartIsNotTakenForTheRate) {
  // Network players hold the first frames back and give them all at once.
  SimulatedDevice device(12, 30, 60);
  ClockEstimator::Options options;
  options.latency_ns = device.latency_ns;
  ClockEstimator clock(options);
  std::vector<SimulatedDevice::Pair> first;
  double worst_ms = 0;
  for (int i = 0; i < 300; ++i) {
    auto pair = device.at(i / 30.0);
    if (i < 22) pair.arrival.ns = device.at(22 / 30.0).arrival.ns + i * 250'000;
    const HostTime host = clock.add(pair.device, pair.arrival);
    EXPECT_LE(host.ns, pair.arrival.ns);
    if (i < 22) first.push_back(pair);
    if (i > 30) worst_ms = std::max(worst_ms, std::abs(error_ms(host, pair.truth)));
    if (i != 40) continue;  // by now the line tells when they were
    for (const auto& p : first) EXPECT_NEAR(error_ms(*clock.host_from_device(p.device), p.truth), 0, 2);
  }
  EXPECT_LT(worst_ms, 2);
  EXPECT_EQ(clock.estimate().restarts, 0u);
}

TEST(ClockEstimator, TellsJitterAndOutliers) {
  SimulatedDevice device(77, 100, 30);
  device.jitter_ms = 2.0;
  device.in_order = false;
  ClockEstimator clock;
  int n = 0;
  for (double t = 0; t < 60; t += 0.01, ++n) {
    const auto pair = device.at(t);
    clock.add(pair.device, pair.arrival);
  }
  // The median absolute deviation of an exponential distribution of mean m is 0.4812 m; tails widen it a bit.
  EXPECT_NEAR(clock.estimate().jitter_ms, 1.4826 * 0.4812 * 2.0, 0.5);
  EXPECT_EQ(clock.estimate().samples, static_cast<std::uint64_t>(n));
  // 5 % are 50 ms late, and 10 % have a tail of which 2 % lie beyond 12 ms.
  EXPECT_NEAR(static_cast<double>(clock.estimate().outliers) / n, 0.055, 0.02);
}

TEST(ClockEstimator, StartsAgainWhenTheDeviceClockJumps) {
  Random seeds(4);
  for (int trial = 0; trial < 10; ++trial) {
    SimulatedDevice device(seeds.next_u32(), 60, seeds.uniform(-200, 200));
    ClockEstimator::Options options;
    options.latency_ns = device.latency_ns;
    ClockEstimator clock(options);
    std::int64_t last_ns = INT64_MIN;
    double worst_ms = 0;
    // Forwards, back, and back to nothing, as a wrap and a power cycle do.
    const std::int64_t jumps_ns[] = {0, 3'600'000'000'000, -4'294'967'296'000, 0};
    for (int i = 0; i < 60 * 80; ++i) {
      const double t = i / 60.0;
      auto pair = device.at(t);
      const int part = i / (60 * 20);
      pair.device.ns = part == 3 ? std::llround((t - 60) * 1e9) : pair.device.ns + jumps_ns[part];
      const HostTime host = clock.add(pair.device, pair.arrival);
      ASSERT_GT(host.ns, last_ns);
      last_ns = host.ns;
      if (i % (60 * 20) > 60 * 5) worst_ms = std::max(worst_ms, std::abs(error_ms(host, pair.truth)));
    }
    EXPECT_EQ(clock.estimate().restarts, 3u);
    EXPECT_LT(worst_ms, 0.5);
  }
}

TEST(ClockEstimator, AStallOrAGlitchIsNotAJump) {
  SimulatedDevice device(5, 60, -150);
  ClockEstimator::Options options;
  options.latency_ns = device.latency_ns;
  ClockEstimator clock(options);
  double worst_ms = 0;
  for (int i = 0; i < 60 * 40; ++i) {
    const double t = i / 60.0;
    auto pair = device.at(t);
    // A second in which the host takes nothing: all of it arrives at once, late.
    if (t > 20 && t < 21) pair.arrival.ns += std::llround((21 - t) * 1e9);
    const bool glitch = i == 60 * 30;
    if (glitch) pair.device.ns += 77'000'000'000;  // one corrupt timestamp
    const HostTime host = clock.add(pair.device, pair.arrival);
    if (t > 5 && !glitch) worst_ms = std::max(worst_ms, std::abs(error_ms(host, pair.truth)));
  }
  EXPECT_EQ(clock.estimate().restarts, 0u);
  // After the glitch time runs on at a tenth of its pace until the line is right again.
  EXPECT_LT(worst_ms, 60);
  EXPECT_NEAR(clock.estimate().drift_ppm, -150, 5);
}

TEST(ClockEstimator, FollowsTheHostsClockWhenItIsSet) {
  for (const std::int64_t step_ns : {120'000'000LL, -120'000'000LL, -3'600'000'000'000LL}) {
    SimulatedDevice device(6, 60, 80);
    ClockEstimator::Options options;
    options.latency_ns = device.latency_ns;
    ClockEstimator clock(options);
    double worst_ms = 0;
    for (int i = 0; i < 60 * 40; ++i) {
      const double t = i / 60.0;
      auto pair = device.at(t);
      if (t > 20) pair.arrival.ns += step_ns, pair.truth.ns += step_ns;
      const HostTime host = clock.add(pair.device, pair.arrival);
      if (t > 5 && !(t > 20 && t < 25)) worst_ms = std::max(worst_ms, std::abs(error_ms(host, pair.truth)));
    }
    EXPECT_EQ(clock.estimate().restarts, 1u) << step_ns;
    EXPECT_LT(worst_ms, 0.5) << step_ns;
  }
}

TEST(ClockEstimator, NothingIsCapturedAfterItArrived) {
  // Steps back that are too small for a jump, also a latency of the wrong sign.
  for (const std::int64_t latency_ns : {0LL, 7'000'000LL, -20'000'000LL})
    for (const std::int64_t step_ns : {-3'000'000LL, -120'000'000LL, -400'000'000LL}) {
      SimulatedDevice device(9, 60, 80);
      ClockEstimator::Options options;
      options.latency_ns = latency_ns;
      ClockEstimator clock(options);
      for (int i = 0; i < 60 * 10; ++i) {
        auto pair = device.at(i / 60.0);
        if (i > 300) pair.arrival.ns += step_ns;
        ASSERT_LE(clock.add(pair.device, pair.arrival).ns, pair.arrival.ns) << i << " " << step_ns;
      }
    }
}

TEST(ClockEstimator, MapsInstantsBetweenAndAheadWithoutGoingBack) {
  SimulatedDevice device(8, 120, 190);
  ClockEstimator clock;
  EXPECT_FALSE(clock.host_from_device({5}));
  for (double t = 0; t < 20; t += 1 / 120.0) {
    const auto pair = device.at(t);
    const HostTime now = clock.add(pair.device, pair.arrival);
    const auto before = clock.host_from_device({pair.device.ns - 4'000'000});
    const auto same = clock.host_from_device(pair.device);
    const auto after = clock.host_from_device({pair.device.ns + 4'000'000});
    ASSERT_TRUE(before && same && after);
    ASSERT_LE(before->ns, now.ns);
    ASSERT_LE(same->ns, now.ns);
    ASSERT_GT(after->ns, now.ns);
  }
}

TEST(ClockEstimator, LongGapsKeepTheDrift) {
  SimulatedDevice device(9, 60, -180);
  ClockEstimator::Options options;
  options.latency_ns = device.latency_ns;
  ClockEstimator clock(options);
  for (double t = 0; t < 60; t += 1 / 60.0) {
    const auto pair = device.at(t);
    clock.add(pair.device, pair.arrival);
  }
  double worst_ms = 0;
  for (double t = 360; t < 420; t += 1 / 60.0) {  // five minutes later
    const auto pair = device.at(t);
    worst_ms = std::max(worst_ms, std::abs(error_ms(clock.add(pair.device, pair.arrival), pair.truth)));
  }
  std::printf("after 5 min without a sample: %.3f ms\n", worst_ms);
  EXPECT_LT(worst_ms, 1.5);
  EXPECT_EQ(clock.estimate().restarts, 0u);
}

}  // namespace
}  // namespace gnathion
