// The stereo scanner against rendered truth, against a real rig's chessboards, and as a device.
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "acquisition/device.h"
#include "acquisition/scanner/scan_devices.h"
#include "acquisition/scanner/stereo_surface.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "tests/support/speckled_face.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// One face for all tests: it takes seconds to make.
const SpeckledFace& face() {
  static const SpeckledFace made = speckled_face(5);
  return made;
}

struct Pair {
  StereoBench bench;
  Image8 first, second;
};

Pair photographed(double distance_mm, bool upright, std::uint64_t seed) {
  Pair p;
  p.bench = stereo_bench(face().face, distance_mm, 120, upright);
  p.first = photograph(face().painted, p.bench.first.model, p.bench.first_from_dental, seed);
  p.second = photograph(face().painted, p.bench.second.model,
                        p.bench.second.rig_from_camera.inverse() * p.bench.first_from_dental, seed + 1);
  return p;
}

const Pair& sideways() {
  static const Pair pair = photographed(450, false, 11);
  return pair;
}

StereoOptions options_for_450mm() {
  StereoOptions o;
  o.near_mm = 350;
  o.far_mm = 550;
  return o;
}

struct Errors {
  std::vector<double> depth_mm, normal_mm, normalised;
};

/// By rays and closest points on the true surface: nothing of the matching's own arithmetic.
Errors errors_against(const TriangleMesh& truth_in_rig, const ScanSurface& scan) {
  const MeshQuery truth(truth_in_rig);
  Errors e;
  for (std::size_t v = 0; v < scan.mesh.vertices_mm.size(); v += 5) {
    const Vector3& p = scan.mesh.vertices_mm[v];
    const auto closest = truth.signed_distance(p);
    if (!closest || closest->closest.on_boundary) continue;
    e.normal_mm.push_back(closest->distance_mm);
    e.normalised.push_back(closest->distance_mm / scan.deviation_mm[v]);
    if (const auto hit = truth.ray(Vector3::Zero(), p.normalized()); hit)
      e.depth_mm.push_back((p.norm() - hit->distance_mm) * p.normalized().z());
  }
  return e;
}

void expect_true_to(const Pair& pair, double least_vertices) {
  const auto found =
      stereo_surface(pair.first, pair.second, pair.bench.first, pair.bench.second, options_for_450mm());
  ASSERT_TRUE(found) << found.error().line();
  EXPECT_GT(static_cast<double>(found->surface.mesh.vertices_mm.size()), least_vertices);
  EXPECT_EQ(found->surface.deviation_mm.size(), found->surface.mesh.vertices_mm.size());
  EXPECT_TRUE(found->report.warnings.empty());
  EXPECT_LT(std::abs(found->report.row_shift_px), 0.1);
  const Errors e = errors_against(transformed(pair.bench.first_from_dental, face().face), found->surface);
  std::vector<double> off, normalised;
  for (const double d : e.normal_mm) off.push_back(std::abs(d));
  for (const double n : e.normalised) normalised.push_back(std::abs(n));
  std::vector<double> depth;
  for (const double d : e.depth_mm) depth.push_back(std::abs(d));
  // In the core of the distribution the stated sigma is the true one; rims and creases have longer tails.
  const double core = quantile(normalised, 0.5) / 0.6745;
  printf(
      "%zu vertices, %d disparities, sigma_d %.3f px\n"
      "depth error: rms %.3f mm, p95 %.3f mm; along the normal: rms %.3f, median %.3f, p95 %.3f, max %.2f "
      "mm\n"
      "error / stated deviation: core %.2f, p95/1.96 %.2f\n",
      found->surface.mesh.vertices_mm.size(), found->report.disparities, found->report.disparity_sigma_px,
      rms(depth), quantile(depth, 0.95), rms(off), quantile(off, 0.5), quantile(off, 0.95), quantile(off, 1),
      core, quantile(normalised, 0.95) / 1.96);
  EXPECT_LT(rms(off), 0.2);
  EXPECT_LT(quantile(off, 0.95), 0.3);
  EXPECT_LT(quantile(depth, 0.95), 0.6);
  EXPECT_GT(core, 0.7);
  EXPECT_LT(core, 1.4);
  EXPECT_LT(quantile(normalised, 0.95) / 1.96, 1.6);
  // Triangles look at the camera.
  const std::vector<Vector3> normals = face_normals(found->surface.mesh);
  std::size_t away = 0;
  for (std::size_t t = 0; t < normals.size(); ++t)
    away += normals[t].dot(found->surface.mesh.corner(t, 0)) > 0;
  EXPECT_EQ(away, 0u);
}

TEST(StereoSurface, AFaceUnderSpeckleIsTrueToATenthOfAMillimetre) {
  expect_true_to(sideways(), 20000);
}

TEST(StereoSurface, CamerasAboveEachOtherDoAsWell) {
  expect_true_to(photographed(450, true, 21), 20000);
}

TEST(StereoSurface, IsTheSameOnAnyNumberOfThreads) {
  const Pair& p = sideways();
  const int before = cv::getNumThreads();
  std::string first;
  for (const int threads : {1, 2, 5}) {
    cv::setNumThreads(threads);
    const auto found = stereo_surface(p.first, p.second, p.bench.first, p.bench.second, options_for_450mm());
    ASSERT_TRUE(found);
    const std::string bytes = format_scan_ply(found->surface);
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first) << threads << " threads";
  }
  cv::setNumThreads(before);
}

TEST(StereoSurface, ARigThatMovedIsNamed) {
  const Pair& p = sideways();
  Image8 shifted = p.second;
  for (int y = shifted.height_px - 1; y > 0; --y)
    for (int x = 0; x < shifted.width_px; ++x) shifted.at(x, y) = p.second.at(x, y - 1);
  const auto found = stereo_surface(p.first, shifted, p.bench.first, p.bench.second, options_for_450mm());
  ASSERT_TRUE(found) << found.error().line();
  EXPECT_NEAR(std::abs(found->report.row_shift_px), 1, 0.25);
  ASSERT_EQ(found->report.warnings.size(), 1u);
  EXPECT_NE(found->report.warnings[0].find("calibrate it again"), std::string::npos);
}

TEST(StereoSurface, RefusesWhatCannotBeMatched) {
  const Pair& p = sideways();
  Random random(3);
  Image8 noise_a = p.first, noise_b = p.second;
  for (Image8* image : {&noise_a, &noise_b})
    for (std::uint8_t& pixel : image->pixels) pixel = static_cast<std::uint8_t>(120 + 3 * random.normal());
  const auto smooth = stereo_surface(noise_a, noise_b, p.bench.first, p.bench.second, options_for_450mm());
  ASSERT_FALSE(smooth);
  EXPECT_NE(smooth.error().line().find("projected pattern"), std::string::npos) << smooth.error().line();
  const auto small = stereo_surface(Image8(640, 480), p.second, p.bench.first, p.bench.second, {});
  ASSERT_FALSE(small);
  EXPECT_NE(small.error().line().find("640x480"), std::string::npos);
  StereoOptions everywhere;
  everywhere.near_mm = 50;
  everywhere.far_mm = 3000;
  const auto wide = stereo_surface(p.first, p.second, p.bench.first, p.bench.second, everywhere);
  ASSERT_FALSE(wide);
  const auto same = stereo_surface(p.first, p.first, p.bench.first, p.bench.first, {});
  ASSERT_FALSE(same);
  EXPECT_NE(same.error().line().find("baseline"), std::string::npos);
}

// The real rig of OpenCV's samples, calibrated here from its other pairs.

class RealBoards : public ::testing::Test {
 protected:
  static constexpr double kSquare_mm = 25;
  void SetUp() override {
    const char* shared = std::getenv("GNATHION_SHARED");
    folder_ = fs::path(shared ? shared : "../shared") / "data" / "camera";
    if (!fs::exists(folder_ / "left01.jpg")) GTEST_SKIP() << "no chessboards in " << folder_;
  }
  std::vector<cv::Point2f> corners(const cv::Mat& image) const {
    std::vector<cv::Point2f> found;
    if (!cv::findChessboardCorners(image, {9, 6}, found)) return {};
    cv::cornerSubPix(image, found, {5, 5}, {-1, -1},
                     {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 40, 1e-3});
    return found;
  }
  cv::Mat read(const std::string& side, int n) const {
    return cv::imread((folder_ / cv::format("%s%02d.jpg", side.c_str(), n)).string(), cv::IMREAD_GRAYSCALE);
  }
  static Image8 to_image(const cv::Mat& m) {
    Image8 image(m.cols, m.rows);
    for (int y = 0; y < m.rows; ++y) std::copy(m.ptr(y), m.ptr(y) + m.cols, &image.at(0, y));
    return image;
  }
  static RigCamera camera(const char* name, const cv::Mat& k, const cv::Mat& d) {
    RigCamera c;
    c.name = name;
    c.model = {640, 480, k.at<double>(0, 0), k.at<double>(1, 1), k.at<double>(0, 2), k.at<double>(1, 2)};
    c.model.k1 = d.at<double>(0);
    c.model.k2 = d.at<double>(1);
    c.model.p1 = d.at<double>(2);
    c.model.p2 = d.at<double>(3);
    c.model.k3 = d.at<double>(4);
    return c;
  }
  fs::path folder_;
};

TEST_F(RealBoards, TheBoardOfAHeldOutPairIsPlane) {
  constexpr int kHeldOut = 3;
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> left, right;
  std::vector<cv::Point2f> held_left;
  for (const int n : {1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14}) {
    const auto l = corners(read("left", n)), r = corners(read("right", n));
    if (n == kHeldOut) held_left = l;
    if (n == kHeldOut || l.empty() || r.empty()) continue;
    board.emplace_back();
    for (int i = 0; i < 54; ++i)
      board.back().emplace_back(float(kSquare_mm * (i % 9)), float(kSquare_mm * (i / 9)), 0.0f);
    left.push_back(l);
    right.push_back(r);
  }
  ASSERT_GE(board.size(), 8u);
  ASSERT_EQ(held_left.size(), 54u);
  cv::Mat k1, d1, k2, d2, r, t, e, f, unused1, unused2;
  cv::calibrateCamera(board, left, {640, 480}, k1, d1, unused1, unused2);
  cv::calibrateCamera(board, right, {640, 480}, k2, d2, unused1, unused2);
  const double reprojection = cv::stereoCalibrate(board, left, right, k1, d1, k2, d2, {640, 480}, r, t, e, f,
                                                  cv::CALIB_FIX_INTRINSIC);
  RigCamera first = camera("left", k1, d1), second = camera("right", k2, d2);
  Rigid3 second_from_first;
  for (int i = 0; i < 3; ++i) {
    second_from_first.translation_mm[i] = t.at<double>(i);
    for (int k = 0; k < 3; ++k) second_from_first.rotation(i, k) = r.at<double>(i, k);
  }
  second.rig_from_camera = second_from_first.inverse();

  StereoOptions options;
  options.near_mm = 200;
  options.far_mm = 800;
  options.step_px = 1;
  const auto found = stereo_surface(to_image(read("left", kHeldOut)), to_image(read("right", kHeldOut)),
                                    first, second, options);
  ASSERT_TRUE(found) << found.error().line();
  // Vertices whose pixel lies inside the board, as its corners say.
  std::vector<Vector3> on_board;
  const std::vector<cv::Point2f> outline = {held_left[0], held_left[8], held_left[53], held_left[45]};
  for (const Vector3& p : found->surface.mesh.vertices_mm) {
    const auto pixel = first.model.project(p);
    if (pixel && cv::pointPolygonTest(outline, {float(pixel->x()), float(pixel->y())}, true) > 4)
      on_board.push_back(p);
  }
  ASSERT_GT(on_board.size(), 1000u);
  // The plane by the median of distances, twice refitted without what lies off it.
  Vector3 centre, normal;
  std::vector<Vector3> used = on_board;
  for (int round = 0; round < 3; ++round) {
    centre = Vector3::Zero();
    for (const Vector3& p : used) centre += p / static_cast<double>(used.size());
    Matrix3 spread = Matrix3::Zero();
    for (const Vector3& p : used) spread += (p - centre) * (p - centre).transpose();
    normal = Eigen::SelfAdjointEigenSolver<Matrix3>(spread).eigenvectors().col(0);
    std::vector<double> off;
    for (const Vector3& p : on_board) off.push_back(std::abs((p - centre).dot(normal)));
    const double gate = 5 * quantile(off, 0.5);
    used.clear();
    for (const Vector3& p : on_board)
      if (std::abs((p - centre).dot(normal)) < gate) used.push_back(p);
  }
  std::vector<double> off;
  for (const Vector3& p : on_board) off.push_back(std::abs((p - centre).dot(normal)));
  printf("board: %zu vertices, stereo reprojection %.2f px, baseline %.1f mm, row shift %.2f px\n",
         on_board.size(), reprojection, found->report.baseline_mm, found->report.row_shift_px);
  printf("off the plane: median %.4f, p95 %.4f squares\n", quantile(off, 0.5) / kSquare_mm,
         quantile(off, 0.95) / kSquare_mm);
  EXPECT_LT(quantile(off, 0.5) / kSquare_mm, 0.04);
  EXPECT_LT(quantile(off, 0.95) / kSquare_mm, 0.2);
}

// The device, its cameras being folders of images.

class StereoScanner : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_stereo_" + std::to_string(::getpid()) + "_" +
                                         ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(root_ / "left");
    fs::create_directories(root_ / "right");
    Rig rig;
    rig.cameras = {sideways().bench.first, sideways().bench.second};
    rig.bow.name = "bow";
    rig.head_frame.name = "head_frame";
    ASSERT_TRUE(write_rig(root_ / "rig.toml", rig));
    config_.kind = "stereo_scanner";
    config_.stream = "face";
    config_.where = "devices.toml: face";
    config_.folder = root_;
    config_.settings = {{"rig", std::string("rig.toml")},
                        {"first_source", std::string("left")},
                        {"second_source", std::string("right")},
                        {"both_rate_hz", 10.0},
                        {"near_mm", 350.0},
                        {"far_mm", 550.0},
                        {"live", false},
                        {"trigger", std::string("once")}};
  }
  void TearDown() override { fs::remove_all(root_); }
  void put(const char* side, int n, const Image8& image) const {
    const cv::Mat view(image.height_px, image.width_px, CV_8U,
                       const_cast<std::uint8_t*>(image.pixels.data()));
    ASSERT_TRUE(cv::imwrite((root_ / side / cv::format("frame_%03d.png", n)).string(), view));
  }
  fs::path root_;
  DeviceConfig config_;
  SystemClock clock_;
};

TEST_F(StereoScanner, ScansOnceFromTwoSourcesAndEnds) {
  put("left", 0, sideways().first);
  put("right", 0, sideways().second);
  auto device = open_device(config_, clock_);
  ASSERT_TRUE(device) << device.error().line();
  const auto sample = (*device)->next();
  ASSERT_TRUE(sample && *sample) << (sample ? "ended" : sample.error().line());
  const auto* scan = std::get_if<ScanSample>(&**sample);
  ASSERT_TRUE(scan);
  EXPECT_EQ(scan->name, "face_0001.ply");
  ASSERT_EQ(scan->files.size(), 3u);
  const std::string& ply = scan->files.at(scan->name);
  const auto mesh = parse_mesh(ply, scan->name);
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_EQ(mesh->colors_rgb.size(), mesh->vertices_mm.size());
  const auto deviations = scan_ply_deviation(ply, scan->name);
  ASSERT_TRUE(deviations) << deviations.error().line();
  EXPECT_EQ(deviations->size(), mesh->vertices_mm.size());
  EXPECT_NEAR(scan->deviation_mm, quantile(*deviations, 0.5), 0.002);
  EXPECT_GT(scan->deviation_mm, 0.02);
  // The pictures are kept as they were taken: the scan can be made again.
  const std::string& png = scan->files.at("face_0001_second.png");
  const cv::Mat back = cv::imdecode(std::vector<char>(png.begin(), png.end()), cv::IMREAD_GRAYSCALE);
  ASSERT_EQ(back.total(), sideways().second.pixels.size());
  EXPECT_TRUE(std::equal(back.datastart, back.dataend, sideways().second.pixels.begin()));
  const auto end = (*device)->next();
  ASSERT_TRUE(end);
  EXPECT_FALSE(*end);
}

TEST_F(StereoScanner, FramesOfDifferentMomentsAreNoPair) {
  put("left", 0, Image8(1280, 720, 90));
  put("right", 0, Image8(1280, 720, 90));
  config_.settings["second_latency_us"] = 500000.0;  // half a second beside the other
  auto device = open_device(config_, clock_);
  ASSERT_TRUE(device) << device.error().line();
  const auto sample = (*device)->next();
  ASSERT_TRUE(sample && *sample);
  const auto* line = std::get_if<LedgerSample>(&**sample);
  ASSERT_TRUE(line);
  EXPECT_NE(line->reason.find("no two frames within 10.0 ms"), std::string::npos) << line->reason;
}

TEST_F(StereoScanner, AnswersEachRequestAndStops) {
  config_.settings["near_mm"] = 440.0;  // few disparities: nothing is found anyway
  config_.settings["far_mm"] = 460.0;
  for (int n = 0; n < 3; ++n) {
    put("left", n, Image8(1280, 720, 90));  // nothing to match: each request gets its refusal
    put("right", n, Image8(1280, 720, 90));
  }
  config_.settings["trigger"] = std::string("request");
  auto device = open_device(config_, clock_);
  ASSERT_TRUE(device) << device.error().line();
  auto* scanner = dynamic_cast<ScanOnRequest*>(device->get());
  ASSERT_TRUE(scanner);
  for (int n = 0; n < 2; ++n) {
    scanner->request_scan();
    const auto sample = (*device)->next();
    ASSERT_TRUE(sample && *sample);
    const auto* line = std::get_if<LedgerSample>(&**sample);
    ASSERT_TRUE(line);
    EXPECT_EQ(line->header.sequence, static_cast<std::uint32_t>(n));
    EXPECT_NE(line->reason.find("matches"), std::string::npos) << line->reason;
  }
  (*device)->stop();
  const auto end = (*device)->next();
  ASSERT_TRUE(end);
  EXPECT_FALSE(*end);
  EXPECT_EQ((*device)->health().rejected, 2u);
}

TEST_F(StereoScanner, ScansAtIntervalsUntilItsCamerasEnd) {
  for (int n = 0; n < 2; ++n) {
    put("left", n, Image8(1280, 720, 90));
    put("right", n, Image8(1280, 720, 90));
  }
  config_.settings["trigger"] = std::string("interval");
  config_.settings["near_mm"] = 440.0;
  config_.settings["far_mm"] = 460.0;
  config_.settings["interval_s"] = 0.05;
  auto device = open_device(config_, clock_);
  ASSERT_TRUE(device) << device.error().line();
  int answers = 0;
  for (;;) {
    const auto sample = (*device)->next();
    ASSERT_TRUE(sample);
    if (!*sample) break;
    ++answers;
  }
  EXPECT_GE(answers, 2);  // a request that finds the cameras at their end is answered too
  EXPECT_LE(answers, 3);
}

TEST_F(StereoScanner, RefusesInOneLine) {
  put("left", 0, Image8(1280, 720, 90));
  put("right", 0, Image8(1280, 720, 90));
  const auto refusal = [&](const std::string& key, ConfigValue value) {
    DeviceConfig config = config_;
    config.settings[key] = std::move(value);
    const auto device = open_device(config, clock_);
    return device ? std::string("opened") : device.error().line();
  };
  EXPECT_NE(refusal("cameras", std::vector<std::string>{"left", "middle"}).find("no camera 'middle'"),
            std::string::npos);
  EXPECT_NE(refusal("first_surce", std::string("x")).find("source"), std::string::npos);
  EXPECT_NE(refusal("triger", std::string("once")).find("trigger"), std::string::npos);
  EXPECT_NE(refusal("far_mm", 100.0).find("near_mm"), std::string::npos);
  EXPECT_NE(refusal("rig", std::string("nowhere.toml")).find("nowhere.toml"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
