// Two streams of one motion in a recording: the offset found, written, applied; refusals.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <cstdlib>
#include <random>

#include "acquisition/recording.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "pipeline/time_calibration_job.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class TimeCalibrationJobTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_time_" + std::to_string(std::random_device()()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const char* name) const { return (folder_ / name).string(); }

  /// A hand moves a body unevenly (or not at all): seen at 60 Hz by one instrument, at 120 Hz by another
  /// whose times are `late_s` too late.
  void record_motion(const char* name, double late_s, double size, std::uint64_t seed) const {
    Random random(seed);
    Vector3 axis[4];
    double hz[4], phase[4];
    for (int k = 0; k < 4; ++k) {
      axis[k] = random.unit_vector();
      hz[k] = random.uniform(0.3, 2.2);
      phase[k] = random.uniform(0, 2 * M_PI);
    }
    const auto pose_at = [&](double t) {
      Vector3 w = Vector3::Zero();
      for (int k = 0; k < 4; ++k) w += size * 0.12 * std::sin(2 * M_PI * hz[k] * t + phase[k]) * axis[k];
      return Rigid3{exp_so3(w), Vector3(10, 20, 30)};
    };
    auto writer = RecordingWriter::create(path(name));
    ASSERT_TRUE(writer) << writer.error().line();
    const Rigid3 elsewhere{random.rotation(), Vector3(100, -50, 400)},
        mounted{random.rotation(), Vector3(3, 4, 5)};
    std::uint32_t cameras = 0, sensors = 0;
    for (int i = 0; i < 1440; ++i) {
      const double t = i / 120.0;
      const auto put = [&](const char* stream, std::uint32_t sequence, double shown_s, const Rigid3& pose,
                           double sigma) {
        PoseSample s;
        s.header.stream = stream;
        s.header.sequence = sequence;
        s.header.capture.ns = 1'000'000'000'000 + std::llround(shown_s * 1e9);
        s.header.arrival.ns = 1'000'000'000'000 + std::llround((t + 0.02) * 1e9);
        s.reference = "room";
        s.body = stream;
        s.reference_from_body = {exp_so3(sigma * random.normal3()) * pose.rotation, pose.translation_mm};
        ASSERT_TRUE(writer->write(s));
      };
      if (sensors % 2 == 0) put("bow", cameras++, t, pose_at(t), 8e-4);
      put("sensor", sensors++, t + late_s, elsewhere * pose_at(t) * mounted, 1.5e-3);
    }
    ASSERT_TRUE(writer->finish());
  }

  Result<TimeCalibrationResult> run(const char* name, const char* first = "bow",
                                    const char* second = "sensor") const {
    TimeCalibrationJob job;
    job.files = {path(name)};
    job.streams = {first, second};
    SilentProgress silent;
    return run_time_calibration(job, silent);
  }
  fs::path folder_;
};

TEST_F(TimeCalibrationJobTest, FindsTheOffsetAndAppliesItOnce) {
  const char* given = std::getenv("GNATHION_SEED");
  const std::uint64_t seed = given ? std::strtoull(given, nullptr, 10) : 20261122;
  Random random(seed);
  const double late_s = random.uniform(-0.08, 0.08);
  record_motion("r.mcap", late_s, 1, seed);
  const auto found = run("r.mcap");
  ASSERT_TRUE(found) << found.error().line() << " seed " << seed;
  // Added to the sensor's times it brings them back.
  EXPECT_NEAR(found->offset.offset_s, -late_s, std::max(5 * found->offset.sigma_s, 3e-4)) << "seed " << seed;
  EXPECT_LT(found->offset.sigma_s, 5e-4);
  TimeCalibrationJob job;
  job.files = {path("r.mcap")};
  job.streams = {"bow", "sensor"};
  ASSERT_TRUE(write_json(path("time.json"), time_calibration_json(job, *found)));
  const std::string text = time_calibration_text(job, *found);
  EXPECT_NE(text.find(std::string("more latency for ") + (late_s > 0 ? "sensor" : "bow")), std::string::npos)
      << text;

  SilentProgress silent;
  const auto moved = shift_recording({path("r.mcap"), path("time.json"), path("s.mcap")}, silent);
  ASSERT_TRUE(moved) << moved.error().line();
  EXPECT_EQ(*moved, 1440u);
  const auto again = run("s.mcap");
  ASSERT_TRUE(again) << again.error().line();
  EXPECT_NEAR(again->offset.offset_s, 0, 1e-4);
  // Nothing but the sensor's capture times has changed.
  auto before = RecordingSource::open(path("r.mcap")), after = RecordingSource::open(path("s.mcap"));
  ASSERT_TRUE(before && after);
  for (int i = 0;; ++i) {
    auto a = (*before)->next(), b = (*after)->next();
    ASSERT_TRUE(a && b);
    ASSERT_EQ(a->has_value(), b->has_value()) << i;
    if (!a->has_value()) break;
    const SampleHeader &x = header_of(**a), &y = header_of(**b);
    EXPECT_EQ(x.sequence, y.sequence);
    EXPECT_EQ(x.arrival.ns, y.arrival.ns);
    EXPECT_EQ(y.capture.ns - x.capture.ns,
              x.stream == "sensor" ? std::llround(found->offset.offset_s * 1e9) : 0);
  }
  const auto twice = shift_recording({path("s.mcap"), path("time.json"), path("t.mcap")}, silent);
  ASSERT_FALSE(twice);
  EXPECT_NE(twice.error().why.find("shifted before"), std::string::npos);
  EXPECT_FALSE(fs::exists(path("t.mcap")));
}

TEST_F(TimeCalibrationJobTest, RefusesStillnessAndStreamsThatAreNotThere) {
  record_motion("still.mcap", 0.02, 0, 7);
  const auto still = run("still.mcap");
  ASSERT_FALSE(still);
  EXPECT_NE(still.error().why.find("does not determine the offset"), std::string::npos)
      << still.error().line();
  const auto absent = run("still.mcap", "bow", "sensr");
  ASSERT_FALSE(absent);
  EXPECT_NE(absent.error().why.find("there are bow, sensor"), std::string::npos) << absent.error().line();
  EXPECT_FALSE(run("still.mcap", "bow", "bow"));
}

}  // namespace
}  // namespace gnathion
