// From rendered images of the three boards to intrinsics: corners against truth, parameters against their
// stated σ.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cstdlib>
#include <random>

#include "calibration/camera_calibration.h"
#include "tests/support/rendered_board.h"
#include "tracking/board_detector.h"

namespace gnathion {
namespace {

using namespace testing;

std::uint64_t fresh_seed() {
  const char* given = std::getenv("GNATHION_SEED");
  const std::uint64_t seed = given ? std::strtoull(given, nullptr, 10) : 20261122;
  std::printf("seed %llu (GNATHION_SEED repeats it)\n", static_cast<unsigned long long>(seed));
  return seed;
}

CameraModel small_camera(Random& random) {
  CameraModel m;
  m.width_px = 640, m.height_px = 480;
  m.fx_px = random.uniform(550, 750);
  m.fy_px = m.fx_px * random.uniform(0.997, 1.003);
  m.cx_px = 319.5 + random.uniform(-10, 10);
  m.cy_px = 239.5 + random.uniform(-10, 10);
  m.k1 = random.uniform(-0.2, 0.02);
  m.k2 = random.uniform(-0.03, 0.06);
  m.p1 = random.uniform(-8e-4, 8e-4);
  m.p2 = random.uniform(-8e-4, 8e-4);
  return m;
}

bool inside(const CalibrationBoard& board, const CameraModel& camera, const Rigid3& pose, double margin_px) {
  for (const Vector3& p : board.points_mm()) {
    const auto px = camera.project(pose * p);
    if (!px || px->x() < margin_px || px->y() < margin_px || px->x() > camera.width_px - margin_px ||
        px->y() > camera.height_px - margin_px)
      return false;
  }
  return true;
}

struct Case {
  const char* board;
  bool corner_squares;
  double corner_limit_px;
};

class Boards : public ::testing::TestWithParam<Case> {};

TEST_P(Boards, ParametersLieWithinTheirStatedSigma) {
  const CalibrationBoard board = *parse_board(GetParam().board);
  const PrintedBoard print(board, GetParam().corner_squares);
  Random random(fresh_seed());
  const char* more = std::getenv("GNATHION_TRIALS");
  const int trials = more ? std::atoi(more) : 2, views_each = 10;
  double nees = 0, squared = 0, stated = 0, count = 0, images = 0, found = 0;
  auto detector = BoardDetector::create(board);
  ASSERT_TRUE(detector);
  const auto points = board.points_mm();
  for (int t = 0; t < trials; ++t) {
    const CameraModel truth = small_camera(random);
    const RayGrid rays(truth);
    std::vector<BoardView> views;
    for (int i = 0; i < views_each; ++i) {
      // A chessboard is found whole or not at all.
      const double margin_px = board.kind == BoardKind::kChessboard ? 25 : -60;
      Rigid3 pose = held_board(board, truth, 0.75, 0.62, random);
      while (!inside(board, truth, pose, margin_px)) pose = held_board(board, truth, 0.75, 0.62, random);
      const Image8 image = render_board(print, truth, rays, pose, {}, random);
      BoardDetection d = (*detector)->detect(image, truth);
      ++images;
      if (!d.found()) continue;
      ++found;
      d.view.name = std::to_string(i);
      for (const BoardCorner& c : d.view.corners) {
        const Eigen::Vector2d error = c.px - *truth.project(pose * points[static_cast<std::size_t>(c.id)]);
        ASSERT_LT(error.norm(), 1.0) << "corner " << c.id << " of " << GetParam().board;
        squared += error.squaredNorm() / 2;
        stated += c.covariance_px2.trace() / 2;
        ++count;
      }
      views.push_back(d.view);
    }
    SilentProgress silent;
    const auto c = calibrate_camera(board, "camera", 640, 480, views, {}, silent);
    ASSERT_TRUE(c) << c.error().line();
    const Vector9 error = intrinsics_of(c->model) - intrinsics_of(truth);
    nees += error.dot(c->covariance.ldlt().solve(error)) / 9;
  }
  const double rms = std::sqrt(squared / count);
  std::printf("%s: corners RMS %.4f px (stated %.4f) over %.0f, boards %.0f of %.0f, NEES/9 %.3f\n",
              GetParam().board, rms, std::sqrt(stated / count), count, found, images, nees / trials);
  RecordProperty("corner_rms_px", std::to_string(rms));
  EXPECT_LT(rms, GetParam().corner_limit_px);
  EXPECT_GE(found, 0.9 * images);
  // Of 9·trials degrees of freedom: four standard deviations.
  const double spread = 4 * std::sqrt(2.0 / (9 * trials));
  EXPECT_LT(nees / trials, 1 + std::max(0.25, spread));
  EXPECT_GT(nees / trials, 0.3);
}

INSTANTIATE_TEST_SUITE_P(
    All, Boards,
    ::testing::Values(Case{"chessboard:9x6:25", true, 0.03}, Case{"charuco:9x7:25:17:4X4_50", true, 0.04},
                      Case{"aprilgrid:5x4:40:0.3", true, 0.04}, Case{"aprilgrid:5x4:40:0.3", false, 0.04}),
    [](const auto& board) {
      const std::string text = board.param.board;
      return text.substr(0, text.find(':')) + (board.param.corner_squares ? "" : "_plain");
    });

TEST(Boards, WhatIsNotTheBoardIsNamed) {
  Random random(fresh_seed());
  const CameraModel camera = small_camera(random);
  const RayGrid rays(camera);
  const auto picture = [&](const char* text) {
    const CalibrationBoard board = *parse_board(text);
    return render_board(PrintedBoard(board), camera, rays, held_board(board, camera, 0.3, 0.6, random), {},
                        random);
  };
  const auto said = [&](const char* board, const Image8& image) {
    auto detector = std::move(*BoardDetector::create(*parse_board(board)));
    const BoardDetection d = detector->detect(image);
    return d.found() ? "found" : d.reason + "; there is " + detector->what_else(image);
  };
  // Of a tilted board at the edge of the picture a column may be too blurred to count: one that is seen
  // whole.
  Image8 chessboard = picture("chessboard:9x6:25");
  for (int draw = 0; draw < 20 && said("chessboard:9x6:25", chessboard) != "found"; ++draw)
    chessboard = picture("chessboard:9x6:25");
  EXPECT_EQ(said("chessboard:9x6:25", chessboard), "found");
  EXPECT_NE(said("chessboard:8x6:25", chessboard).find("9x6"), std::string::npos)
      << said("chessboard:8x6:25", chessboard);
  EXPECT_NE(said("chessboard:9x5:25", chessboard).find("9x6"), std::string::npos)
      << said("chessboard:9x5:25", chessboard);
  EXPECT_NE(said("chessboard:10x7:25", chessboard).find("9x6"), std::string::npos)
      << said("chessboard:10x7:25", chessboard);
  const Image8 grid = picture("aprilgrid:5x4:40:0.3");
  EXPECT_EQ(said("aprilgrid:5x4:40:0.3", grid), "found");
  EXPECT_NE(said("aprilgrid:4x5:40:0.3", grid).find("5 tags wide"), std::string::npos)
      << said("aprilgrid:4x5:40:0.3", grid);
  const Image8 charuco = picture("charuco:9x7:25:17:4X4_50");
  EXPECT_EQ(said("charuco:9x7:25:17:4X4_50", charuco), "found");
  EXPECT_NE(said("charuco:7x9:25:17:4X4_50", charuco).find("9 squares wide"), std::string::npos)
      << said("charuco:7x9:25:17:4X4_50", charuco);
  EXPECT_NE(said("charuco:9x7:25:17:5X5_100", charuco).find("4X4"), std::string::npos)
      << said("charuco:9x7:25:17:5X5_100", charuco);
  for (const char* text : {"aprilgrid:5x4:40:0.3", "charuco:9x7:25:17:4X4_50"}) {
    Image8 mirrored = picture(text);
    for (int y = 0; y < mirrored.height_px; ++y)
      std::reverse(mirrored.pixels.begin() + y * mirrored.width_px,
                   mirrored.pixels.begin() + (y + 1) * mirrored.width_px);
    EXPECT_NE(said(text, mirrored).find("mirror image"), std::string::npos) << said(text, mirrored);
  }
  EXPECT_NE(said("chessboard:9x6:25", Image8(640, 480, 128)).find("no chessboard"), std::string::npos);
  EXPECT_NE(said("aprilgrid:5x4:40:0.3", Image8(8, 8, 128)).find("no tag"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
