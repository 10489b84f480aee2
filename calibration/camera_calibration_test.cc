// Calibration from corners with known truth: stated covariances against errors, and everything that must be
// refused.
#include "calibration/camera_calibration.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cstdlib>
#include <random>

#include "calibration/rig_calibration.h"
#include "core/random.h"

namespace gnathion {
namespace {

CameraModel some_camera(Random& random) {
  CameraModel m;
  m.fx_px = random.uniform(900, 1300);
  m.fy_px = m.fx_px * random.uniform(0.995, 1.005);
  m.cx_px = 639.5 + random.uniform(-20, 20);
  m.cy_px = 359.5 + random.uniform(-20, 20);
  m.k1 = random.uniform(-0.25, 0.05);
  m.k2 = random.uniform(-0.05, 0.1);
  m.p1 = random.uniform(-1e-3, 1e-3);
  m.p2 = random.uniform(-1e-3, 1e-3);
  return m;
}

/// A board held before the camera, tilted up to `tilt_rad`, somewhere in the image.
Rigid3 board_pose(const CalibrationBoard& board, double tilt_rad, Random& random) {
  Vector3 middle = Vector3::Zero();
  const auto points = board.points_mm();
  for (const Vector3& p : points) middle += p / static_cast<double>(points.size());
  const double phi = random.uniform(0, 2 * M_PI);
  const Matrix3 turn = exp_so3(random.uniform(0.5, 1) * tilt_rad * Vector3(std::cos(phi), std::sin(phi), 0)) *
                       exp_so3(Vector3(0, 0, random.uniform(-0.4, 0.4)));
  const double z = random.uniform(320, 600);
  const Vector3 at(random.uniform(-0.3, 0.3) * z, random.uniform(-0.16, 0.16) * z, z);
  return {turn, at - turn * middle};
}

/// What a detector sees of it: noise that differs from corner to corner, as it says.
BoardView seen(const CalibrationBoard& board, const CameraModel& camera, const Rigid3& pose,
               const std::string& name, double sigma_px, Random& random, double sag_mm = 0) {
  BoardView view;
  view.name = name;
  const auto points = board.points_mm();
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vector3 p = points[i];
    const Vector3 from_middle = p - 0.5 * (points.front() + points.back());
    p.z() += sag_mm * from_middle.squaredNorm() / (0.25 * (points.back() - points.front()).squaredNorm());
    const Vector3 in_camera = pose * p;
    if (in_camera.z() < 50) continue;
    const auto px = camera.project(in_camera);
    if (!px || px->x() < 3 || px->y() < 3 || px->x() > camera.width_px - 4 || px->y() > camera.height_px - 4)
      continue;
    const double sigma = sigma_px * random.uniform(0.5, 1.5);
    view.corners.push_back({static_cast<int>(i),
                            *px + sigma * Eigen::Vector2d(random.normal(), random.normal()),
                            sigma * sigma * Eigen::Matrix2d::Identity()});
  }
  return view;
}

std::vector<BoardView> film(const CalibrationBoard& board, const CameraModel& camera, int count,
                            double tilt_rad, double sigma_px, Random& random, double sag_mm = 0,
                            const std::string& prefix = "view") {
  std::vector<BoardView> views;
  for (int i = 0; i < count; ++i)
    views.push_back(seen(board, camera, board_pose(board, tilt_rad, random), prefix + std::to_string(i),
                         sigma_px, random, sag_mm));
  return views;
}

CalibrationBoard board_of(const char* text) {
  return *parse_board(text);
}

std::uint64_t fresh_seed() {
  const char* given = std::getenv("GNATHION_SEED");
  const std::uint64_t seed = given ? std::strtoull(given, nullptr, 10) : 20261122;
  ::testing::Test::RecordProperty("seed", std::to_string(seed));
  std::printf("seed %llu (GNATHION_SEED repeats it)\n", static_cast<unsigned long long>(seed));
  return seed;
}

Result<CameraCalibration> calibrate(const CalibrationBoard& board, const std::vector<BoardView>& views,
                                    CameraCalibrationOptions options = {}) {
  SilentProgress silent;
  return calibrate_camera(board, "camera", 1280, 720, views, options, silent);
}

TEST(CalibrationBoard, ReadsItsOwnText) {
  for (const char* text : {"chessboard:9x6:25", "charuco:7x5:30:22:4X4_50", "aprilgrid:6x6:30:0.3:tag36h11"})
    EXPECT_EQ(board_of(text).text(), text);
  EXPECT_EQ(board_of("chessboard:9x6:25").points_mm().size(), 54u);
  EXPECT_EQ(board_of("charuco:7x5:30:22:4X4_50").points_mm().size(), 24u);
  EXPECT_EQ(board_of("aprilgrid:6x5:30:0.3").points_mm().size(), 120u);
  for (const char* text :
       {"", "chessboard", "chessboard:9x6", "chessboard:9x6:0", "chessboard:9:25", "chessboard:2x6:25",
        "chessboard:9x6:25:1", "charuco:7x5:30:40:4X4_50", "aprilgrid:6x6:30:3", "circles:4x4:2",
        "chessboard:9x6:nan", "aprilgrid:60x60:30:0.3", "chessboard:-9x6:25"})
    EXPECT_FALSE(parse_board(text)) << text;
}

/// Errors against the stated covariance: (error² / σ²) summed over nine parameters has mean 9.
TEST(CameraCalibration, StatedCovarianceHolds) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  double nees = 0, focal = 0;
  const int trials = 30;
  int inside = 0;
  for (int t = 0; t < trials; ++t) {
    const CameraModel truth = some_camera(random);
    // Every other detector calls itself half as noisy as it is: the observed noise must tell.
    auto views = film(board, truth, 15, 0.7, 0.05, random);
    if (t % 2 == 1)
      for (BoardView& v : views)
        for (BoardCorner& c : v.corners) c.covariance_px2 *= 0.25;
    const auto c = calibrate(board, views);
    ASSERT_TRUE(c) << c.error().line();
    const Vector9 error = intrinsics_of(c->model) - intrinsics_of(truth);
    const double e2 = error.dot(c->covariance.ldlt().solve(error));
    nees += e2 / 9;
    inside += e2 < 16.92;  // 95 % of χ²(9)
    const double f_error = 0.5 * (error[0] + error[1]) / c->focal_sigma_px();
    focal += f_error * f_error;
    EXPECT_NEAR(c->held_out_px, c->rms_px, 0.25 * c->rms_px);
  }
  std::printf("NEES/9 %.3f, focal %.3f, %d of %d inside 95 %%\n", nees / trials, focal / trials, inside,
              trials);
  // 540 degrees of freedom: σ of the mean 0.061; the noise differs by corner, which the scale flattens a
  // little.
  EXPECT_GT(nees / trials, 0.78);
  EXPECT_LT(nees / trials, 1.25);
  EXPECT_GE(inside, static_cast<int>(0.85 * trials));
}

TEST(CameraCalibration, OutliersDoNotMoveIt) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("aprilgrid:6x5:25:0.3");
  const CameraModel truth = some_camera(random);
  auto views = film(board, truth, 14, 0.7, 0.05, random);
  for (BoardView& v : views)
    for (std::size_t i = 0; i < v.corners.size(); i += 25)
      v.corners[i].px += 8 * Eigen::Vector2d(random.normal(), random.normal());
  const auto c = calibrate(board, views);
  ASSERT_TRUE(c) << c.error().line();
  const Vector9 error = intrinsics_of(c->model) - intrinsics_of(truth);
  EXPECT_LT(error.dot(c->covariance.ldlt().solve(error)), 27.9);  // 99.9 % of χ²(9)
  EXPECT_LT(c->sigma(0), 1.5);
}

TEST(CameraCalibration, RefusesWhatDoesNotDetermineIt) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  const CameraModel truth = some_camera(random);
  const auto why = [&](const std::vector<BoardView>& views) {
    const auto c = calibrate(board, views);
    return c ? "accepted, f = " + std::to_string(c->model.fx_px) : c.error().why;
  };
  EXPECT_NE(why({}).find("0 views"), std::string::npos) << why({});
  EXPECT_NE(why(film(board, truth, 2, 0.7, 0.05, random)).find("2 distinct"), std::string::npos);
  // The same picture twenty times.
  const BoardView one = seen(board, truth, board_pose(board, 0.7, random), "a", 0.05, random);
  EXPECT_NE(why(std::vector<BoardView>(20, one)).find("1 distinct"), std::string::npos);
  // The camera before a board that stands still, with fresh noise.
  const Rigid3 still = board_pose(board, 0.7, random);
  std::vector<BoardView> views;
  for (int i = 0; i < 20; ++i) views.push_back(seen(board, truth, still, std::to_string(i), 0.05, random));
  EXPECT_NE(why(views).find("1 distinct"), std::string::npos);
  // No view is tilted: f and the distance cannot be told apart.
  for (int t = 0; t < 2; ++t) {
    views.clear();
    for (int i = 0; i < 15; ++i) {
      Rigid3 pose = board_pose(board, 0, random);
      pose.rotation = exp_so3(Vector3(0, 0, random.uniform(-0.5, 0.5)));
      views.push_back(seen(board, truth, pose, std::to_string(i), 0.1, random));
    }
    EXPECT_NE(why(views).find("focal length open"), std::string::npos) << why(views);
  }
}

TEST(CameraCalibration, TellsTwoCamerasFromOne) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  for (int t = 0; t < 4; ++t) {
    const CameraModel first = some_camera(random);
    CameraModel second = first;
    second.fx_px *= 1.02, second.fy_px *= 1.02;
    second.cx_px += 8, second.cy_px -= 6;
    second.k1 += 0.02;
    auto views = film(board, first, 10, 0.7, 0.05, random);
    ASSERT_TRUE(calibrate(board, views)) << calibrate(board, views).error().line();
    for (BoardView& v : film(board, second, 10, 0.7, 0.05, random, 0, "other")) views.push_back(v);
    const auto mixed = calibrate(board, views);
    ASSERT_FALSE(mixed);
    EXPECT_NE(mixed.error().why.find("two cameras"), std::string::npos) << mixed.error().line();
  }
}

TEST(CameraCalibration, WarnsOfBentBoardsThinCoverageAndFewViews) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  const CameraModel truth = some_camera(random);
  const auto warned = [](const CameraCalibration& c, const char* word) {
    for (const std::string& w : c.warnings)
      if (w.find(word) != std::string::npos) return true;
    return false;
  };
  const auto flat = calibrate(board, film(board, truth, 30, 0.7, 0.05, random));
  ASSERT_TRUE(flat) << flat.error().line();
  EXPECT_FALSE(warned(*flat, "bent"));
  EXPECT_FALSE(warned(*flat, "only"));
  EXPECT_LT(flat->bend.sag_mm, 5 * flat->bend.sigma_mm);
  const auto bent = calibrate(board, film(board, truth, 30, 0.7, 0.05, random, 0.8));
  ASSERT_TRUE(bent) << bent.error().line();
  EXPECT_TRUE(warned(*bent, "bent"));
  EXPECT_GT(bent->bend.sag_mm, 0.2);
  const auto few = calibrate(board, film(board, truth, 6, 0.7, 0.05, random));
  ASSERT_TRUE(few) << few.error().line();
  EXPECT_TRUE(warned(*few, "only 6 views"));
  // All views in the left half of the image.
  std::vector<BoardView> left;
  while (left.size() < 12) {
    BoardView v =
        seen(board, truth, board_pose(board, 0.7, random), "l" + std::to_string(left.size()), 0.05, random);
    double most = 0;
    for (const BoardCorner& c : v.corners) most = std::max(most, c.px.x());
    if (most < 800 && v.corners.size() > 40) left.push_back(v);
  }
  const auto thin = calibrate(board, left);
  ASSERT_TRUE(thin) << thin.error().line();
  EXPECT_TRUE(warned(*thin, "right"));
}

TEST(CameraCalibration, SeesAFocalLengthThatMoves) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  CameraModel truth = some_camera(random);
  const double f = truth.fx_px, ratio = truth.fy_px / truth.fx_px;
  std::vector<BoardView> views;
  for (int i = 0; i < 25; ++i) {
    truth.fx_px = f * (1 + 0.004 * random.normal());
    truth.fy_px = ratio * truth.fx_px;
    views.push_back(seen(board, truth, board_pose(board, 0.7, random), std::to_string(i), 0.05, random));
  }
  const auto c = calibrate(board, views);
  if (c) {
    EXPECT_GT(c->focal_drift_share, 0.001);
    EXPECT_LT(c->focal_drift_share, 0.01);
  } else {
    EXPECT_NE(c.error().why.find("the lens was moved"), std::string::npos) << c.error().line();
  }
}

struct RigTruth {
  std::vector<CameraModel> models;
  std::vector<Rigid3> rig_from_camera;
};

RigTruth some_rig(int cameras, Random& random) {
  RigTruth rig;
  for (int c = 0; c < cameras; ++c) {
    rig.models.push_back(some_camera(random));
    const Vector3 at(120.0 * c + random.uniform(-5, 5), random.uniform(-10, 10), random.uniform(-10, 10));
    rig.rig_from_camera.push_back(
        c == 0 ? Rigid3::identity()
               : Rigid3{exp_so3(Vector3(random.uniform(-0.03, 0.03), -0.2 * c, random.uniform(-0.03, 0.03))),
                        at});
  }
  return rig;
}

std::vector<RigCameraViews> film_rig(const CalibrationBoard& board, const RigTruth& rig, int instants,
                                     double sigma_px, Random& random) {
  std::vector<RigCameraViews> cameras;
  for (std::size_t c = 0; c < rig.models.size(); ++c)
    cameras.push_back({"camera_" + std::to_string(c), 1280, 720, {}});
  for (int i = 0; i < instants; ++i) {
    const Rigid3 pose = board_pose(board, 0.6, random);
    for (std::size_t c = 0; c < rig.models.size(); ++c) {
      BoardView v = seen(board, rig.models[c], rig.rig_from_camera[c].inverse() * pose, std::to_string(i),
                         sigma_px, random);
      if (v.corners.size() >= 30) cameras[c].views.push_back(v);
    }
  }
  return cameras;
}

TEST(RigCalibration, StatedCovarianceHolds) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("charuco:9x7:25:18:4X4_50");
  double nees = 0;
  const int trials = 8;
  for (int t = 0; t < trials; ++t) {
    const RigTruth rig = some_rig(t % 3 == 0 ? 3 : 2, random);
    SilentProgress silent;
    const auto r = calibrate_rig(board, film_rig(board, rig, 20, 0.05, random), {}, silent);
    ASSERT_TRUE(r) << r.error().line();
    const auto cameras = static_cast<Eigen::Index>(rig.models.size());
    Eigen::VectorXd error(15 * cameras - 6);
    for (Eigen::Index c = 0; c < cameras; ++c) {
      const auto k = static_cast<std::size_t>(c);
      error.segment<9>(9 * c) = intrinsics_of(r->cameras[k].camera.model) - intrinsics_of(rig.models[k]);
      // X = exp(ξ)·X̂ for the truth X: the error of the estimate has the other sign.
      if (c > 0)
        error.segment<6>(9 * cameras + 6 * (c - 1)) =
            -difference(rig.rig_from_camera[k], r->cameras[k].rig_from_camera);
    }
    nees += error.dot(r->covariance.ldlt().solve(error)) / static_cast<double>(error.size());
    EXPECT_NEAR(r->cameras[1].held_out_rig_px, r->rms_px, 0.6 * r->rms_px);
  }
  std::printf("rig NEES/dof %.3f\n", nees / trials);
  EXPECT_GT(nees / trials, 0.7);  // about 220 degrees of freedom: σ of the mean 0.095
  EXPECT_LT(nees / trials, 1.4);
}

TEST(RigCalibration, RefusesCamerasThatShareNothingAndPairsThatAreNone) {
  Random random(fresh_seed());
  const CalibrationBoard board = board_of("chessboard:9x6:25");
  SilentProgress silent;
  const RigTruth rig = some_rig(2, random);
  auto apart = film_rig(board, rig, 14, 0.05, random);
  for (BoardView& v : apart[1].views) v.name = "other" + v.name;
  const auto r = calibrate_rig(board, apart, {}, silent);
  ASSERT_FALSE(r);
  EXPECT_NE(r.error().why.find("never sees the board together"), std::string::npos) << r.error().line();
  EXPECT_EQ(r.error().where, "camera_1");
  // Pairs shifted by one: every view has a partner, of another instant.
  auto shifted = film_rig(board, rig, 16, 0.05, random);
  for (BoardView& v : shifted[1].views) v.name = std::to_string(std::stoi(v.name) + 1);
  const auto s = calibrate_rig(board, shifted, {}, silent);
  ASSERT_FALSE(s);
  EXPECT_NE(s.error().why.find("agree about where it stands"), std::string::npos) << s.error().line();
  // A board that looks the same upside down.
  EXPECT_FALSE(calibrate_rig(board_of("chessboard:8x6:25"),
                             film_rig(board_of("chessboard:8x6:25"), rig, 14, 0.05, random), {}, silent));
}

}  // namespace
}  // namespace gnathion
