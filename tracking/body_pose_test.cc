#include "tracking/body_pose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tracking/planar_pose.h"
#include "tracking/projection.h"
#include "tracking/synthetic_rig.h"

namespace gnathion {
namespace {

using testing::bench_pose;
using testing::bench_rig;
using testing::observe;

TEST(Projection, AgreesWithTheCameraModelAndItsJacobianWithDifferences) {
  CameraModel camera = testing::bench_camera();
  camera.p2 = -0.0007;
  camera.k3 = 0.01;
  Random random(3);
  for (int i = 0; i < 50; ++i) {
    const Vector3 p(random.uniform(-150, 150), random.uniform(-90, 90), random.uniform(250, 500));
    Eigen::Matrix<double, 2, 3> j;
    const Eigen::Vector2d pixel = project_with_jacobian(camera, p, &j);
    EXPECT_LE((pixel - *camera.project(p)).norm(), 1e-9);
    for (int axis = 0; axis < 3; ++axis) {
      const double h = 1e-4;
      const Vector3 step = h * Vector3::Unit(axis);
      const Eigen::Vector2d slope = (*camera.project(p + step) - *camera.project(p - step)) / (2 * h);
      EXPECT_LE((slope - j.col(axis)).norm(), 1e-6);
    }
  }
}

TEST(PlanarPose, OneOfTheTwoIsTheTruth) {
  const Rig rig = bench_rig();
  Random random(4);
  for (int i = 0; i < 30; ++i) {
    const Rigid3 truth = bench_pose(random, 0);
    const auto corners = projected_tag(rig.cameras[0], rig.bow.tags[2], truth);
    ASSERT_TRUE(corners);
    double best = 1e9;
    for (const Rigid3& p : planar_poses(rig.cameras[0].model, rig.bow.tags[2], *corners)) {
      best = std::min(best, difference(p, truth).norm());
    }
    EXPECT_LE(best, 1e-5);
  }
}

TEST(BodyPose, IsExactWithoutNoise) {
  Random random(11);
  for (const int cameras : {1, 2}) {
    const Rig rig = bench_rig(cameras);
    for (int i = 0; i < 20; ++i) {
      const Rigid3 truth = bench_pose(random, 0);
      RigTags tags = observe(rig, rig.bow, truth, 0, random);
      for (auto& camera : tags) {
        for (auto& o : camera) o.covariance_px2 = 1e-4 * Matrix8::Identity();
      }
      const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, {});
      ASSERT_TRUE(pose.valid) << pose.reason;
      EXPECT_LE((pose.camera_from_body * Vector3(0, 0, 80) - truth * Vector3(0, 0, 80)).norm(), 1e-6);
      EXPECT_LE((pose.camera_from_body.inverse() * truth).angle_rad(), 1e-8);
    }
  }
}

/// Mean of ξᵀΣ⁻¹ξ/6 over noise seeds: 1 where the stated covariance is true.
double normalised_error(int cameras, double stated_sigma_px, double true_sigma_px, int runs) {
  const Rig rig = bench_rig(cameras);
  Random random(static_cast<std::uint64_t>(runs + cameras));
  double sum = 0;
  for (int i = 0; i < runs; ++i) {
    const Rigid3 truth = bench_pose(random, 0);
    RigTags tags = observe(rig, rig.bow, truth, true_sigma_px, random);
    for (auto& camera : tags) {
      for (auto& o : camera) o.covariance_px2 = stated_sigma_px * stated_sigma_px * Matrix8::Identity();
    }
    const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, {});
    EXPECT_TRUE(pose.valid) << pose.reason;
    const Vector6 xi = difference(truth, pose.camera_from_body);
    sum += xi.dot(pose.covariance.ldlt().solve(xi)) / 6;
  }
  return sum / runs;
}

TEST(BodyPose, CovarianceIsTrueByMonteCarlo) {
  for (const int cameras : {1, 2}) {
    const double nees = normalised_error(cameras, 0.03, 0.03, 600);
    std::printf("pose covariance, %d camera(s): normalised error squared / 6 = %.3f\n", cameras, nees);
    EXPECT_GE(nees, 0.85);
    EXPECT_LE(nees, 1.18);
  }
}

TEST(BodyPose, CovarianceFollowsTheResidualsWhereTheNoiseIsLargerThanStated) {
  const double nees = normalised_error(1, 0.03, 0.09, 400);
  EXPECT_GE(nees, 0.85);
  EXPECT_LE(nees, 1.35);
}

TEST(BodyPose, WrongIdsAndShiftedTagsAreRejected) {
  const Rig rig = bench_rig();
  Random random(21);
  for (int i = 0; i < 30; ++i) {
    const Rigid3 truth = bench_pose(random, 0);
    RigTags tags = observe(rig, rig.bow, truth, 0.03, random);
    ASSERT_GE(tags[0].size(), 6u);
    std::swap(tags[0][0].id, tags[0][3].id);             // two wrong ids
    for (auto& p : tags[0][5].corners_px) p.x() += 2.0;  // a tag that slid
    const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, {});
    ASSERT_TRUE(pose.valid) << pose.reason;
    EXPECT_THAT(pose.rejected_ids,
                ::testing::UnorderedElementsAre(tags[0][0].id, tags[0][3].id, tags[0][5].id));
    EXPECT_LE((pose.camera_from_body * Vector3(0, 0, 0) - truth * Vector3(0, 0, 0)).norm(), 0.1);
  }
}

TEST(BodyPose, SaysWhyItIsNotValid) {
  const Rig rig = bench_rig();
  Random random(22);
  const Rigid3 truth = bench_pose(random, 0);
  RigTags tags(1);
  EXPECT_EQ(estimate_body_pose(rig, rig.bow, tags, {}).reason, "no tag seen");
  tags = observe(rig, rig.bow, truth, 0.03, random);
  RigTags one = {{tags[0][0]}};
  EXPECT_EQ(estimate_body_pose(rig, rig.bow, one, {}).reason, "1 tag, need 2");
  BodyPoseOptions three;
  three.min_tags = 3;
  RigTags two = {{tags[0][0], tags[0][5]}};
  EXPECT_EQ(estimate_body_pose(rig, rig.bow, two, three).reason, "2 tags, need 3");
  EXPECT_TRUE(estimate_body_pose(rig, rig.bow, two, {}).valid);
  for (auto& o : tags[0]) {
    for (auto& p : o.corners_px) p += Eigen::Vector2d(random.uniform(-9, 9), random.uniform(-9, 9));
  }
  const BodyPose scattered = estimate_body_pose(rig, rig.bow, tags, {});
  EXPECT_FALSE(scattered.valid);
  EXPECT_THAT(scattered.reason, ::testing::Not(::testing::IsEmpty()));
}

TEST(BodyPose, APlanarFlipIsResolvedByTheOtherTagsAndAWrongGuessDoesNotStick) {
  // Far away and frontal: each tag alone is ambiguous.
  const Rig rig = bench_rig();
  Random random(23);
  for (int i = 0; i < 30; ++i) {
    const Rigid3 truth = bench_pose(random, 0, 600);
    const RigTags tags = observe(rig, rig.bow, truth, 0.08, random);
    const auto flips = planar_poses(rig.cameras[0].model, rig.bow.tags[1], tags[0][1].corners_px);
    for (const Rigid3& flip : flips) {
      const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, {}, flip);
      ASSERT_TRUE(pose.valid) << pose.reason;
      EXPECT_LE((pose.camera_from_body.inverse() * truth).angle_rad(), 0.02);
    }
  }
}

TEST(ProjectedTag, FacesAwayIsNothing) {
  const Rig rig = bench_rig();
  const Rigid3 front{Matrix3::Identity(), Vector3(0, 0, 400)};
  EXPECT_TRUE(projected_tag(rig.cameras[0], rig.bow.tags[1], front));
  const Rigid3 turned{exp_so3(Vector3(0, M_PI, 0)), Vector3(0, 0, 400)};
  EXPECT_FALSE(projected_tag(rig.cameras[0], rig.bow.tags[1], turned));
  const Rigid3 behind{Matrix3::Identity(), Vector3(0, 0, -400)};
  EXPECT_FALSE(projected_tag(rig.cameras[0], rig.bow.tags[1], behind));
}

}  // namespace
}  // namespace gnathion
