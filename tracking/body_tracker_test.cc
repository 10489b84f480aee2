#include "tracking/body_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tracking/body_checks.h"
#include "tracking/synthetic_rig.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;
using testing::render_tags;
using testing::scene_tags;
using testing::SceneLook;
using testing::SceneTag;

const TagFamily& family() {
  static const TagFamily instance = *TagFamily::load("tag36h11");
  return instance;
}

/// Half the real resolution; six tags a body.
Rig little_rig() {
  Rig rig = testing::bench_rig();
  CameraModel& camera = rig.cameras[0].model;
  camera.width_px = 640;
  camera.height_px = 440;
  camera.fx_px = camera.fy_px = 640;
  camera.cx_px = 319.5;
  camera.cy_px = 219.5;
  rig.cameras[0].line_time_ns = 0;
  rig.bow = testing::arc_body("bow", 0, 6);
  rig.head_frame = testing::arc_body("head_frame", 20, 6);
  return rig;
}

struct Truth {
  Rigid3 bow, head;
};

Truth truth_at(double t_s) {
  Truth truth;
  truth.head = {exp_so3(Vector3(0.02 * std::sin(2 * t_s), 0.12, 0.01)), Vector3(4 + 10 * t_s, -48, 300)};
  truth.bow = truth.head * Rigid3{exp_so3(Vector3(0.1 * std::sin(4 * t_s), 0, 0)),
                                  Vector3(0, 70 + 3 * std::sin(4 * t_s), 0)};
  return truth;
}

Image8 picture(const Rig& rig, const Truth& truth, std::uint64_t seed, const SceneLook& look = {}) {
  std::vector<SceneTag> tags = scene_tags(rig.bow, truth.bow);
  const auto more = scene_tags(rig.head_frame, truth.head);
  tags.insert(tags.end(), more.begin(), more.end());
  Random random(seed);
  return render_tags(rig.cameras[0].model, family(), tags, look, random);
}

HostTime frame_time(int i) {
  return {1'000'000'000LL + i * 16'666'667LL};
}

double error_mm(const BodyPose& pose, const Rigid3& truth) {
  const Vector3 point(0, 10, 50);
  return (pose.camera_from_body * point - truth * point).norm();
}

struct Outcome {
  BodyPoses clean, spoilt;
  Truth truth;
};

/// Two frames as they are, then a third that `spoil` was at; tracked with and without.
Outcome tracked_with(const std::function<void(Image8&, const TagCorners&, const TagCorners&)>& spoil,
                     std::uint64_t seed, const SceneLook& last_look = {}) {
  const Rig rig = little_rig();
  Outcome outcome;
  for (const bool spoilt : {false, true}) {
    auto tracker = std::move(*BodyTracker::create(rig, {}));
    for (int i = 0; i < 3; ++i) {
      outcome.truth = truth_at(i / 60.0);
      Image8 image = picture(rig, outcome.truth, seed + static_cast<std::uint64_t>(i),
                             spoilt && i == 2 ? last_look : SceneLook{});
      if (spoilt && i == 2) {
        spoil(image, *projected_tag(rig.cameras[0], rig.bow.tags[1], outcome.truth.bow),
              *projected_tag(rig.cameras[0], rig.bow.tags[4], outcome.truth.bow));
      }
      BodyPoses poses = tracker->next(frame_time(i), {&image});
      if (i == 2) (spoilt ? outcome.spoilt : outcome.clean) = std::move(poses);
    }
  }
  return outcome;
}

void paint_disc(Image8& image, const Eigen::Vector2d& centre, double radius_px, std::uint8_t grey) {
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {
      if ((Eigen::Vector2d(x, y) - centre).norm() < radius_px) image.at(x, y) = grey;
    }
  }
}

TEST(BodyTracker, SomethingOverAnEdgeDoesNotPullThePose) {
  // A finger's edge over the middle of a side of one tag, and over a corner of another.
  for (const std::uint8_t grey : {std::uint8_t{60}, std::uint8_t{140}}) {
    const Outcome o = tracked_with(
        [grey](Image8& image, const TagCorners& a, const TagCorners& b) {
          paint_disc(image, 0.5 * (a[0] + a[1]), 6, grey);
          paint_disc(image, b[2], 7, grey);
        },
        31);
    ASSERT_TRUE(o.spoilt.bow.valid) << o.spoilt.bow.reason;
    std::printf("covered (grey %d): %.4f mm, clean %.4f mm\n", grey, error_mm(o.spoilt.bow, o.truth.bow),
                error_mm(o.clean.bow, o.truth.bow));
    EXPECT_LE(error_mm(o.spoilt.bow, o.truth.bow), error_mm(o.clean.bow, o.truth.bow) + 0.03);
  }
}

TEST(BodyTracker, AHighlightDoesNotPullThePose) {
  const Outcome o = tracked_with(
      [](Image8& image, const TagCorners& a, const TagCorners& b) {
        paint_disc(image, 0.7 * a[1] + 0.3 * a[2], 8, 255);
        paint_disc(image, 0.5 * (b[0] + b[3]), 7, 255);
      },
      41);
  ASSERT_TRUE(o.spoilt.bow.valid) << o.spoilt.bow.reason;
  std::printf("highlight: %.4f mm, clean %.4f mm\n", error_mm(o.spoilt.bow, o.truth.bow),
              error_mm(o.clean.bow, o.truth.bow));
  EXPECT_LE(error_mm(o.spoilt.bow, o.truth.bow), error_mm(o.clean.bow, o.truth.bow) + 0.03);
}

TEST(BodyTracker, BlurAndDefocusWidenTheCovarianceInsteadOfPulling) {
  for (const bool motion : {false, true}) {
    SceneLook look;
    if (motion) look.motion_px = {3, 1};
    if (!motion) look.psf_px = 1.5;
    const Outcome o = tracked_with([](Image8&, const TagCorners&, const TagCorners&) {}, 51, look);
    ASSERT_TRUE(o.spoilt.bow.valid) << o.spoilt.bow.reason;
    const Vector6 xi = difference(o.truth.bow, o.spoilt.bow.camera_from_body);
    const double nees = xi.dot(o.spoilt.bow.covariance.ldlt().solve(xi)) / 6;
    std::printf("%s: %.4f mm, clean %.4f mm, normalised %.2f\n", motion ? "motion" : "defocus",
                error_mm(o.spoilt.bow, o.truth.bow), error_mm(o.clean.bow, o.truth.bow), nees);
    EXPECT_LE(error_mm(o.spoilt.bow, o.truth.bow), 0.08);
    EXPECT_GT(o.spoilt.bow.covariance.trace(), o.clean.bow.covariance.trace());
    EXPECT_LE(nees, 3.5);  // χ² with 6 degrees of freedom: 99.8 %
  }
}

TEST(BodyTracker, TilesFindTheBodiesWithoutAWholeSearchAndLossIsTold) {
  const Rig rig = little_rig();
  BodyTrackerOptions options;
  options.search_tiles = 1;
  auto tracker = std::move(*BodyTracker::create(rig, options));
  const Image8 image = picture(rig, truth_at(0), 3), grey(640, 440, 90);
  int frames = 0;
  BodyPoses poses;
  do {
    poses = tracker->next(frame_time(frames), {&image});
  } while (++frames < 70 && !(poses.bow.valid && poses.head.valid));
  EXPECT_LE(frames, 63) << "every tile was searched once";
  ASSERT_TRUE(poses.bow.valid && poses.head.valid) << poses.bow.reason << poses.head.reason;
  EXPECT_GE(tracker->next(frame_time(frames++), {&image}).bow.tags_used, 5);
  poses = tracker->next(frame_time(frames++), {&grey});
  EXPECT_EQ(poses.bow.reason, "no tag seen");
  poses = tracker->next(frame_time(frames++), {&image});
  EXPECT_TRUE(poses.bow.valid && poses.head.valid) << "found again where they were predicted";
}

/// Corners as a rolling shutter sees a body that moves with `velocity`: each exposed when its row is.
RigTags observe_rolling(const Rig& rig, const TaggedBody& body, const Rigid3& pose, const Vector6& velocity,
                        double sigma_px, Random& random) {
  RigTags tags(1);
  const CameraModel& camera = rig.cameras[0].model;
  const double line_s = 1e-9 * *rig.cameras[0].line_time_ns;
  for (const BodyTag& tag : body.tags) {
    TagObservation o;
    o.id = tag.id;
    for (std::size_t k = 0; k < 4; ++k) {
      Eigen::Vector2d pixel = *camera.project(pose * tag.corners_in_body_mm[k]);
      for (int i = 0; i < 20; ++i) {
        const double t_s = line_s * (pixel.y() - 0.5 * (camera.height_px - 1));
        pixel = *camera.project(exp_se3(t_s * velocity) * pose * tag.corners_in_body_mm[k]);
      }
      o.corners_px[k] = pixel + sigma_px * Eigen::Vector2d(random.normal(), random.normal());
    }
    o.covariance_px2 = sigma_px * sigma_px * Matrix8::Identity();
    o.refined = true;
    tags[0].push_back(o);
  }
  return tags;
}

TEST(BodyPose, ARollingShutterIsModelledAndItsVelocityMatters) {
  Rig rig = testing::bench_rig();
  rig.cameras[0].line_time_ns = 20'000;  // 14 ms from the first row to the last
  Random random(5);
  double modelled = 0, neglected = 0, normalised = 0;
  constexpr int kRuns = 60;
  for (int i = 0; i < kRuns; ++i) {
    const Rigid3 truth = testing::bench_pose(random, 60);
    Vector6 velocity;
    velocity << 0.5 * random.unit_vector(), 100 * random.unit_vector();
    velocity.tail<3>() -= velocity.head<3>().cross(truth.translation_mm);  // turns about the body
    const RigTags tags = observe_rolling(rig, rig.bow, truth, velocity, 0.02, random);
    const BodyPose with = estimate_body_pose(rig, rig.bow, tags, {}, truth, velocity);
    const BodyPose without = estimate_body_pose(rig, rig.bow, tags, {}, truth);
    ASSERT_TRUE(with.valid) << with.reason;
    modelled += error_mm(with, truth) / kRuns;
    if (!without.valid) continue;
    neglected += error_mm(without, truth) / kRuns;
    const Vector6 xi = difference(truth, without.camera_from_body);
    normalised += xi.dot(without.covariance.ldlt().solve(xi)) / 6 / kRuns;
  }
  std::printf("rolling shutter: %.4f mm modelled, %.3f mm without a velocity (normalised %.2f)\n", modelled,
              neglected, normalised);
  EXPECT_LE(modelled, 0.04);
  EXPECT_GE(neglected, 3 * modelled);
  EXPECT_LE(normalised, 2) << "the wider covariance owns up to it";
}

TEST(BodyPose, ThePastDecidesBetweenTwoPosesThatFit) {
  // One small plane far away: both of its poses fit. The past tells which.
  Rig rig = testing::bench_rig();
  rig.bow.tags = {testing::body_tag(0, Vector3(0, 0, 0), 0, 0, 8),
                  testing::body_tag(1, Vector3(10, 0, 0), 0, 0, 8)};
  Random random(6);
  int doubts = 0;
  for (int i = 0; i < 20; ++i) {
    const Rigid3 truth{exp_so3(Vector3(0.3, 0.2, 0)), Vector3(0, 0, 900)};
    const RigTags tags = testing::observe(rig, rig.bow, truth, 0.05, random);
    const BodyPose alone = estimate_body_pose(rig, rig.bow, tags, {});
    doubts += !alone.valid && alone.reason.find("two poses") == 0;
    const Rigid3 past{exp_so3(Vector3(0.01, 0, 0)) * truth.rotation, truth.translation_mm};
    const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, {}, past);
    ASSERT_TRUE(pose.valid) << pose.reason;
    EXPECT_LE((pose.camera_from_body.inverse() * truth).angle_rad(), 0.2);
  }
  EXPECT_GT(doubts, 5);
}

// ---- What the frames tell about the files ----

/// The evidence of `frames` poses, tracked with `rig`, of scenes taken with `truly`.
SessionEvidence evidence_of(const Rig& truly, const Rig& rig, int frames, std::size_t* valid,
                            double focal_drift = 0) {
  SessionEvidence evidence(1);
  Random random(77);
  for (int i = 0; i < frames; ++i) {
    if (focal_drift != 0 && i == frames / 2) {
      SessionEvidence later(1);
      Rig refocused = truly;
      refocused.cameras[0].model.fx_px *= 1 + focal_drift;
      refocused.cameras[0].model.fy_px *= 1 + focal_drift;
      later = evidence_of(refocused, rig, frames - i, valid);
      evidence.merge(later);
      return evidence;
    }
    const Rigid3 head = testing::bench_pose(random, -40), bow = testing::bench_pose(random, 50);
    RigTags tags = testing::observe(truly, truly.bow, bow, 0.03, random);
    const RigTags more = testing::observe(truly, truly.head_frame, head, 0.03, random);
    tags[0].insert(tags[0].end(), more[0].begin(), more[0].end());
    BodyPoses poses;
    poses.bow = estimate_body_pose(rig, rig.bow, tags, {});
    poses.head = estimate_body_pose(rig, rig.head_frame, tags, {});
    poses.searched = true;
    if (!poses.bow.valid || !poses.head.valid) poses.tags = tags;
    *valid += poses.bow.valid && poses.head.valid;
    evidence.add(poses, {nullptr});
  }
  return evidence;
}

TaggedBody with_tags(TaggedBody body, double scale) {
  for (BodyTag& tag : body.tags) {
    const auto c = tag.corners_in_body_mm;
    const Vector3 centre = 0.25 * (c[0] + c[1] + c[2] + c[3]);
    for (Vector3& p : tag.corners_in_body_mm) p = centre + scale * (p - centre);
  }
  return body;
}

Rig known_rig() {
  Rig rig = testing::bench_rig();
  rig.cameras[0].line_time_ns = 0;
  return rig;
}

TEST(SessionEvidence, ARightRigIsNeitherRefusedNorWarnedOf) {
  std::size_t valid = 0;
  const SessionEvidence e = evidence_of(known_rig(), known_rig(), 60, &valid);
  EXPECT_EQ(valid, 60u);
  EXPECT_TRUE(e.refusal(known_rig(), valid, "").has_value());
  EXPECT_THAT(e.warnings(known_rig()), ::testing::IsEmpty());
  Rig unknown = known_rig();
  unknown.cameras[0].line_time_ns.reset();
  ASSERT_EQ(e.warnings(unknown).size(), 1u);
  EXPECT_THAT(e.warnings(unknown)[0], HasSubstr("line_time_ns"));
}

TEST(SessionEvidence, TagsOfAnotherSizeAreRefusedWithTheirSize) {
  for (const double scale : {0.9, 0.96, 1.05, 1.25}) {
    Rig truly = known_rig();
    truly.bow = with_tags(truly.bow, scale);
    std::size_t valid = 0;
    const SessionEvidence e = evidence_of(truly, known_rig(), 20, &valid);
    const Status status = e.refusal(known_rig(), valid, "residual");
    ASSERT_FALSE(status.has_value()) << scale << ", " << valid << " valid";
    EXPECT_THAT(status.error().line(), HasSubstr("bow"));
    double told_mm = 0;
    const std::string line = status.error().line();
    const std::size_t at =
        line.find(" measure ") != std::string::npos ? line.find(" measure ") + 9 : line.find("about ") + 6;
    told_mm = std::atof(line.c_str() + at);
    EXPECT_NEAR(told_mm, 20 * scale, 0.4) << line;
  }
}

TEST(SessionEvidence, ARigOfOtherCamerasIsRefusedAndADriftTold) {
  for (const double scale : {0.8, 1.3}) {
    Rig truly = known_rig();
    truly.cameras[0].model.fx_px *= scale;
    truly.cameras[0].model.fy_px *= scale;
    std::size_t valid = 0;
    const SessionEvidence e = evidence_of(truly, known_rig(), 60, &valid);
    const Status status = e.refusal(known_rig(), valid, "residual");
    ASSERT_FALSE(status.has_value()) << scale << ", " << valid << " valid";
    EXPECT_THAT(status.error().line(), HasSubstr("focal length"));
  }
  std::size_t valid = 0;
  const SessionEvidence e = evidence_of(known_rig(), known_rig(), 400, &valid, 0.012);
  EXPECT_THAT(e.warnings(known_rig()), ::testing::Contains(HasSubstr("drifts")));
}

TEST(SessionEvidence, ABowUpsideDownIsRefusedWhereTheFilesSayWhatIsUp) {
  Rig rig = known_rig();
  std::size_t valid = 0;
  const SessionEvidence e = evidence_of(rig, rig, 5, &valid);
  EXPECT_TRUE(e.refusal(rig, valid, "").has_value());
  rig.bow.up = -Vector3::UnitY();
  rig.head_frame.up = -Vector3::UnitY();
  EXPECT_TRUE(e.refusal(rig, valid, "").has_value());
  rig.bow.up = Vector3::UnitY();
  const Status status = e.refusal(rig, valid, "");
  ASSERT_FALSE(status.has_value());
  EXPECT_THAT(status.error().line(), HasSubstr("upside down"));
}

TEST(SessionEvidence, TwoBowsInViewAndMirroredPicturesAreRefused) {
  const Rig rig = little_rig();
  const Truth truth = truth_at(0);
  Truth aside = truth;
  aside.bow.translation_mm = Vector3(0, 70, 420);
  aside.head.translation_mm = Vector3(-75, -60, 420);
  const Rigid3 second{Matrix3::Identity(), Vector3(80, -60, 420)};
  std::vector<SceneTag> tags = scene_tags(rig.bow, aside.bow);
  for (const auto& more : {scene_tags(rig.head_frame, aside.head), scene_tags(rig.bow, second)})
    tags.insert(tags.end(), more.begin(), more.end());
  Random random(8);
  const Image8 two = render_tags(rig.cameras[0].model, family(), tags, {}, random);
  auto tracker = std::move(*BodyTracker::create(rig, {}));
  SessionEvidence evidence(1);
  evidence.add(tracker->next(frame_time(0), {&two}), {&two});
  Status status = evidence.refusal(rig, 1, "");
  ASSERT_FALSE(status.has_value());
  EXPECT_THAT(status.error().line(), HasSubstr("two places"));

  Image8 mirrored = picture(rig, truth, 9);
  for (int y = 0; y < mirrored.height_px; ++y) {
    for (int x = 0; x < mirrored.width_px / 2; ++x)
      std::swap(mirrored.at(x, y), mirrored.at(mirrored.width_px - 1 - x, y));
  }
  tracker->reset();
  SessionEvidence flipped(1);
  const BodyPoses poses = tracker->next(frame_time(0), {&mirrored});
  EXPECT_FALSE(poses.bow.valid);
  flipped.add(poses, {&mirrored});
  status = flipped.refusal(rig, 0, "no tag seen");
  ASSERT_FALSE(status.has_value());
  EXPECT_THAT(status.error().line(), HasSubstr("mirrored"));
}

}  // namespace
}  // namespace gnathion
