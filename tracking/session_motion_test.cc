#include "tracking/session_motion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tracking/list_source.h"
#include "tracking/synthetic_rig.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;
using testing::ListSource;
using testing::render_tags;
using testing::scene_tags;
using testing::SceneLook;
using testing::SceneTag;

/// Half the size of the real rig, so that tests are quick; bodies nearer.
Rig small_rig(int cameras) {
  Rig rig = testing::bench_rig(cameras);
  for (RigCamera& c : rig.cameras) {
    c.model.width_px = 640;
    c.model.height_px = 400;
    c.model.fx_px = c.model.fy_px = 600;
    c.model.cx_px = 319.5;
    c.model.cy_px = 199.5;
  }
  rig.bow = testing::arc_body("bow", 0, 4);
  rig.head_frame = testing::arc_body("head_frame", 20, 4);
  return rig;
}

struct Truth {
  Rigid3 bow, head;
};

Truth truth_at(int frame) {
  const double t = frame / 60.0;
  Truth truth;
  truth.head = {exp_so3(Vector3(0.02 * std::sin(2 * t), 0.15, 0.01)), Vector3(4 * std::sin(3 * t), -28, 290)};
  truth.bow = truth.head *
              Rigid3{exp_so3(Vector3(0.1 * std::sin(4 * t), 0, 0)), Vector3(0, 55 + 3 * std::sin(4 * t), 0)};
  return truth;
}

FrameSample film_frame(const Rig& rig, std::size_t camera, int frame) {
  static const TagFamily family = *TagFamily::load("tag36h11");
  Random random(static_cast<std::uint64_t>(1000 * frame) + camera);
  const Truth truth = truth_at(frame);
  const Rigid3 camera_from_rig = rig.cameras[camera].rig_from_camera.inverse();
  std::vector<SceneTag> tags = scene_tags(rig.bow, camera_from_rig * truth.bow);
  const auto more = scene_tags(rig.head_frame, camera_from_rig * truth.head);
  tags.insert(tags.end(), more.begin(), more.end());
  SceneLook look;
  look.oversampling = 4;
  FrameSample sample;
  sample.header.stream = rig.cameras[camera].name;
  sample.header.sequence = static_cast<std::uint32_t>(100 + frame);
  sample.header.capture.ns =
      1'000'000'000LL + frame * 16'666'667LL + static_cast<std::int64_t>(camera) * 300'000;
  sample.image = render_tags(rig.cameras[camera].model, family, tags, look, random);
  return sample;
}

constexpr int kFrames = 20;

const std::vector<FrameSample>& film(int cameras) {
  static std::map<int, std::vector<FrameSample>> films;
  auto& frames = films[cameras];
  if (frames.empty()) {
    const Rig rig = small_rig(cameras);
    for (int i = 0; i < kFrames; ++i) {
      for (int c = 0; c < cameras; ++c) frames.push_back(film_frame(rig, static_cast<std::size_t>(c), i));
    }
  }
  return frames;
}

SessionMotion tracked(const Rig& rig, std::vector<Sample> samples, int threads = 2) {
  ListSource source(std::move(samples));
  TrackOptions options;
  options.threads = threads;
  options.chunk_frames = 8;
  SilentProgress progress;
  auto session = track_session(source, rig, options, progress);
  EXPECT_TRUE(session.has_value()) << session.error().line();
  return std::move(*session);
}

std::vector<Sample> samples_of(const std::vector<FrameSample>& frames) {
  return std::vector<Sample>(frames.begin(), frames.end());
}

TEST(TrackSession, EveryFrameHasARowWithTheTruePose) {
  for (const int cameras : {1, 2}) {
    const Rig rig = small_rig(cameras);
    const SessionMotion session = tracked(rig, samples_of(film(cameras)));
    ASSERT_EQ(session.rows.size(), static_cast<std::size_t>(kFrames));
    double squares = 0;
    for (int i = 0; i < kFrames; ++i) {
      const MotionRow& row = session.rows[static_cast<std::size_t>(i)];
      ASSERT_TRUE(row.valid()) << row.reason();
      EXPECT_EQ(row.sequence, static_cast<std::uint32_t>(100 + i));
      EXPECT_EQ(row.cameras, cameras);
      EXPECT_GE(row.bow.tags_used, 4);
      const Truth truth = truth_at(i);
      const Vector3 point(0, 0, 60);
      squares += (row.head_from_bow() * point - truth.head.inverse() * truth.bow * point).squaredNorm();
    }
    const double rms_mm = std::sqrt(squares / kFrames);
    std::printf("%d camera(s), 4 tags a body, f 600: %.3f mm RMS at 60 mm\n", cameras, rms_mm);
    EXPECT_LE(rms_mm, 0.15);  // half the focal length and half the tags of the real rig
    EXPECT_EQ(session.full_searches, 3u) << "one search a chunk";
  }
}

TEST(TrackSession, DoesNotDependOnThreads) {
  const Rig rig = small_rig(1);
  const SessionMotion one = tracked(rig, samples_of(film(1)), 1),
                      three = tracked(rig, samples_of(film(1)), 3);
  ASSERT_EQ(one.rows.size(), three.rows.size());
  for (std::size_t i = 0; i < one.rows.size(); ++i) {
    EXPECT_EQ(one.rows[i].bow.camera_from_body.matrix(), three.rows[i].bow.camera_from_body.matrix());
    EXPECT_EQ(one.rows[i].head.covariance, three.rows[i].head.covariance);
  }
}

TEST(TrackSession, FramesThatNeverCameHaveRowsAndReasons) {
  const Rig rig = small_rig(1);
  std::vector<Sample> samples;
  for (int i = 0; i < kFrames; ++i) {
    if (i == 5 || i == 6 || i == 12) continue;
    samples.push_back(film(1)[static_cast<std::size_t>(i)]);
    if (i == 11) {
      LedgerSample told;
      told.header.stream = "camera_0";
      told.header.sequence = 112;
      told.fate = LedgerSample::Fate::kRejected;
      told.reason = "short read";
      samples.push_back(told);
      EventSample event;
      event.header.stream = "pedal";
      event.header.capture.ns = 1'200'000'000LL;
      event.kind = "MI";
      samples.push_back(event);
    }
  }
  const SessionMotion session = tracked(rig, samples);
  ASSERT_EQ(session.rows.size(), static_cast<std::size_t>(kFrames));
  for (int i = 0; i < kFrames; ++i)
    EXPECT_EQ(session.rows[static_cast<std::size_t>(i)].sequence, 100u + static_cast<unsigned>(i));
  EXPECT_EQ(session.rows[5].reason(), "missing: counter gap");
  EXPECT_EQ(session.rows[6].reason(), "missing: counter gap");
  EXPECT_EQ(session.rows[12].reason(), "rejected: short read");
  EXPECT_NEAR(session.time_s(session.rows[6]), 6 / 60.0, 1e-4);
  const StreamLedger& ledger = session.ledger.at("camera_0");
  EXPECT_EQ(ledger.frames, static_cast<std::size_t>(kFrames - 3));
  EXPECT_EQ(ledger.missing, 2u);
  EXPECT_EQ(ledger.rejected, 1u);
  ASSERT_EQ(session.events.size(), 1u);
  EXPECT_TRUE(session.rows[7].valid())
      << "after a gap the bodies are found again: " << session.rows[7].reason();
}

TEST(TrackSession, ACounterThatBeginsAnewHidesNoLostFrame) {
  const Rig rig = small_rig(1);
  std::vector<Sample> samples;
  for (int i = 0; i < kFrames; ++i) {
    if (i == 4 || i == 14) continue;  // 104 of the first run, 103 of the second: its 104 arrives
    FrameSample frame = film(1)[static_cast<std::size_t>(i)];
    if (i > 10) frame.header.sequence = static_cast<std::uint32_t>(100 + i - 11);
    samples.push_back(frame);
  }
  const SessionMotion session = tracked(rig, samples);
  ASSERT_EQ(session.rows.size(), static_cast<std::size_t>(kFrames));
  for (const std::size_t lost : {4u, 14u}) {
    EXPECT_EQ(session.rows[lost].reason(), "missing: counter gap");
    EXPECT_NEAR(session.time_s(session.rows[lost]), static_cast<double>(lost) / 60.0, 1e-4);
  }
  EXPECT_EQ(session.ledger.at("camera_0").missing, 2u);
}

TEST(TrackSession, OneCameraMissingStillGivesARow) {
  const Rig rig = small_rig(2);
  std::vector<Sample> samples;
  for (std::size_t i = 0; i < film(2).size(); ++i) {
    if (i != 7) samples.push_back(film(2)[i]);  // camera_1 of instant 3
  }
  const SessionMotion session = tracked(rig, samples);
  ASSERT_EQ(session.rows.size(), static_cast<std::size_t>(kFrames));
  EXPECT_EQ(session.rows[3].cameras, 1);
  EXPECT_TRUE(session.rows[3].valid());
  EXPECT_EQ(session.ledger.at("camera_1").missing, 1u);
}

TEST(TrackSession, BlindFramesSayWhy) {
  const Rig rig = small_rig(1);
  std::vector<Sample> samples = samples_of(film(1));
  for (std::size_t i : {4u, 5u}) {
    auto& image = std::get<FrameSample>(samples[i]).image;
    std::fill(image.pixels.begin(), image.pixels.end(), std::uint8_t{90});
  }
  const SessionMotion session = tracked(rig, samples);
  EXPECT_FALSE(session.rows[4].valid());
  EXPECT_EQ(session.rows[4].reason(), "no tag seen");
  EXPECT_TRUE(session.rows[6].valid()) << session.rows[6].reason();
}

TEST(TrackSession, RefusesFramesOfAnotherSizeAndForeignStreams) {
  const Rig rig = small_rig(1);
  SilentProgress progress;
  FrameSample frame;
  frame.header.stream = "camera_0";
  frame.image = Image8(320, 200);
  ListSource wrong_size({frame});
  auto session = track_session(wrong_size, rig, {}, progress);
  ASSERT_FALSE(session.has_value());
  EXPECT_EQ(session.error().code, ErrorCode::kInput);
  EXPECT_THAT(session.error().line(), HasSubstr("320×200"));
  frame.header.stream = "webcam";
  ListSource foreign({frame});
  session = track_session(foreign, rig, {}, progress);
  ASSERT_FALSE(session.has_value());
  EXPECT_THAT(session.error().line(), HasSubstr("webcam"));
  Rig twice = rig;
  twice.head_frame.tags[0].id = twice.bow.tags[0].id;
  ListSource empty({});
  session = track_session(empty, twice, {}, progress);
  ASSERT_FALSE(session.has_value());
  EXPECT_THAT(session.error().line(), HasSubstr("there twice"));
}

}  // namespace
}  // namespace gnathion
