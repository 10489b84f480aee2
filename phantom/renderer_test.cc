#include "phantom/renderer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"
#include "phantom/film_test_scene.h"
#include "phantom/renderer_layers.h"

namespace gnathion {
namespace {

CameraModel bent_camera() {
  CameraModel camera;
  camera.k1 = -0.14, camera.k2 = 0.06, camera.p1 = 0.0007, camera.p2 = -0.0005;
  return camera;
}

RenderOptions quiet(double blur_sigma_px = 0.7) {
  RenderOptions options;
  options.noise_sigma = 0;
  options.vignetting = 0;
  options.clutter = false;
  options.blur_sigma_px = blur_sigma_px;
  return options;
}

SceneBody one_tag(int id, double side_mm = 20) {
  SceneBody body;
  body.tags.name = "card";
  body.tags.tags.push_back(film_test::tag_on(id, Rigid3{}, side_mm));
  return body;
}

/// A tag that faces the camera but for a tilt (its z towards the camera), about 400 mm away.
Rigid3 random_pose(Random& random, double tilt_rad = 0.6) {
  const Matrix3 facing = Vector3(1, -1, -1).asDiagonal();
  const Vector3 tilt(random.uniform(-tilt_rad, tilt_rad), random.uniform(-tilt_rad, tilt_rad),
                     random.uniform(-3, 3));
  return {exp_so3(Vector3(tilt.x(), tilt.y(), 0)) * exp_so3(Vector3(0, 0, tilt.z())) * facing,
          Vector3(random.uniform(-170, 170), random.uniform(-80, 80), random.uniform(350, 450))};
}

CameraRenderer renderer_of(std::vector<SceneBody> bodies, const RenderOptions& options,
                           const CameraModel& camera = bent_camera()) {
  auto renderer = CameraRenderer::create(camera, std::move(bodies), options);
  if (!renderer) throw std::runtime_error(renderer.error().line());
  return std::move(*renderer);
}

/// Where the side a–b crosses column (or row) `line`, by bisection on the projected 3-D edge.
double crossing(const CameraModel& camera, const Vector3& a, const Vector3& b, int axis, double line) {
  double low = 0, high = 1;
  const auto coordinate = [&](double s, int k) { return (*camera.project(a + s * (b - a)))[k]; };
  const bool rising = coordinate(1, axis) > coordinate(0, axis);
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    ((coordinate(middle, axis) < line) == rising ? low : high) = middle;
  }
  return coordinate(low, 1 - axis);
}

/// Errors (px, along the scan line) of one side's position, measured by how much white there is on
/// scan lines across it: light is conserved by the lens blur, so this is exact for a straight edge.
std::vector<double> side_errors(const std::vector<float>& light, const CameraModel& camera, const Vector3& a,
                                const Vector3& b) {
  const Eigen::Vector2d pa = *camera.project(a), pb = *camera.project(b), along = pb - pa;
  const int axis = std::abs(along.y()) > std::abs(along.x()) ? 1 : 0;  // scan lines step along this axis
  const auto value = [&](int scan, int at) {
    const int x = axis == 1 ? at : scan, y = axis == 1 ? scan : at;
    return double(light[size_t(y) * size_t(camera.width_px) + size_t(x)]);
  };
  const double first = std::min(pa[axis], pb[axis]), last = std::max(pa[axis], pb[axis]);
  const double ends = 0.25 * (last - first);  // clear of the corners, also of slanted ones
  std::vector<double> errors;
  for (int scan = int(std::ceil(first + ends)); scan < last - ends; ++scan) {
    const double expected = crossing(camera, a, b, axis, scan);
    const int middle = int(std::lround(expected)), from = middle - 4, to = middle + 4;
    const double before = value(scan, from), after = value(scan, to);
    EXPECT_GT(std::abs(after - before), 120) << "contrast";
    double share = 0;  // of `after` between from and to
    for (int at = from; at <= to; ++at) share += (value(scan, at) - before) / (after - before);
    errors.push_back(to + 0.5 - share - expected);
  }
  return errors;
}

TEST(CoveredShare, AgreesWithCounting) {
  Random random(11);
  for (int trial = 0; trial < 200; ++trial) {
    const double a = random.uniform(-1, 1), b = trial % 9 ? random.uniform(-1, 1) : 0,
                 d = random.uniform(-0.9, 0.9);
    constexpr int kSide = 400;
    int inside = 0;
    for (int i = 0; i < kSide * kSide; ++i)
      inside += a * ((i % kSide + 0.5) / kSide - 0.5) + b * ((i / kSide + 0.5) / kSide - 0.5) + d > 0;
    EXPECT_NEAR(render::covered_share(a, b, d), double(inside) / (kSide * kSide), 0.004);
  }
}

TEST(Renderer, TagEdgesStandWhereTheLensPutsThem) {
  const CameraModel camera = bent_camera();
  Random random(2025);
  std::vector<double> errors;
  for (int trial = 0; trial < 12; ++trial) {
    const SceneBody body =
        one_tag(trial * 13, 32);  // wide modules: the scan lines end on plain black and white
    const Rigid3 pose = trial == 0 ? Rigid3{Matrix3(Vector3(1, -1, -1).asDiagonal()), Vector3(3, 2, 400)}
                                   : random_pose(random, 0.5);
    const std::vector<float> light = renderer_of({body}, quiet()).light({{pose, {}}});
    const auto& corners = body.tags.tags[0].corners_in_body_mm;
    for (std::size_t side = 0; side < 4; ++side)
      for (const double e : side_errors(light, camera, pose * corners[side], pose * corners[(side + 1) % 4]))
        errors.push_back(e);
  }
  ASSERT_GT(errors.size(), 500u);
  double sum = 0, squares = 0, largest = 0;
  for (const double e : errors) sum += e, squares += e * e, largest = std::max(largest, std::abs(e));
  const double n = double(errors.size());
  RecordProperty("edge_rms_px", std::to_string(std::sqrt(squares / n)));
  RecordProperty("edge_max_px", std::to_string(largest));
  EXPECT_LT(std::abs(sum / n), 0.001);
  EXPECT_LT(std::sqrt(squares / n), 0.003);
  EXPECT_LT(largest, 0.01);
}

TEST(Renderer, AgreesWithBruteForce) {
  const CameraModel camera = bent_camera();
  Random random(7);
  for (int trial = 0; trial < 3; ++trial) {
    const TagImage pattern = tag_image("tag36h11", 40 + trial).value();
    const Rigid3 pose = random_pose(random), inverse = pose.inverse();
    const std::vector<float> light = renderer_of({one_tag(40 + trial)}, quiet(0)).light({{pose, {}}});
    const Eigen::Vector2d centre = *camera.project(pose.translation_mm);
    double worst = 0, total = 0;
    int count = 0;
    for (int y = int(centre.y()) - 45; y < int(centre.y()) + 45; ++y)
      for (int x = int(centre.x()) - 45; x < int(centre.x()) + 45; ++x) {
        constexpr int kSide = 24;
        double white = 0, black = 0;
        for (int k = 0; k < kSide * kSide; ++k) {
          const double dx = (k % kSide + random.uniform()) / kSide - 0.5,
                       dy = (k / kSide + random.uniform()) / kSide - 0.5;
          const Eigen::Vector2d n = camera.undistorted(Eigen::Vector2d(x + dx, y + dy));
          const Vector3 direction = inverse.rotation * Vector3(n.x(), n.y(), 1), eye = inverse.translation_mm;
          const Vector3 hit = eye - direction * (eye.z() / direction.z());
          const int column = int(std::floor(hit.x() / 2.5 + 5)), row = int(std::floor(5 - hit.y() / 2.5));
          if (column < 0 || row < 0 || column > 9 || row > 9) continue;
          (pattern.is_white(column, row) ? white : black) += 1.0 / (kSide * kSide);
        }
        // Shading is read from the picture itself: the tag's white margin over its nominal white.
        const double got = double(light[size_t(y) * 1280 + size_t(x)]);
        const Eigen::Vector2d margin = *camera.project(pose * Vector3(11.25, 0, 0));
        const double shade =
            light[size_t(std::lround(margin.y())) * 1280 + size_t(std::lround(margin.x()))] / 225.0;
        const double expected = shade * (225 * white + 25 * black) + 110 * (1 - white - black);
        worst = std::max(worst, std::abs(got - expected));
        total += std::abs(got - expected);
        ++count;
      }
    EXPECT_LT(worst, 4.0);  // jittered sampling itself is good to about 1
    EXPECT_LT(total / count, 0.15);
  }
}

TEST(Renderer, LensBlurIsGaussian) {
  Random random(3);
  const Rigid3 pose = random_pose(random);
  const std::vector<float> sharp = renderer_of({one_tag(5)}, quiet(0)).light({{pose, {}}});
  const std::vector<float> soft = renderer_of({one_tag(5)}, quiet(0.8)).light({{pose, {}}});
  double worst = 0;
  for (int y = 8; y < 712; ++y)
    for (int x = 8; x < 1272; ++x) {
      if (std::abs(sharp[size_t(y) * 1280 + size_t(x)] - 110) < 1e-3 && (x + y) % 16)
        continue;  // mostly the tag
      double sum = 0, weights = 0;
      for (int j = -5; j <= 5; ++j)
        for (int i = -5; i <= 5; ++i) {
          const double w = std::exp(-(i * i + j * j) / (2 * 0.8 * 0.8));
          sum += w * double(sharp[size_t(y + j) * 1280 + size_t(x + i)]);
          weights += w;
        }
      worst = std::max(worst, std::abs(sum / weights - double(soft[size_t(y) * 1280 + size_t(x)])));
    }
  EXPECT_LT(worst, 0.05);
}

TEST(Renderer, MotionBlurIsTheMeanOverTheExposure) {
  Random random(5);
  const Rigid3 pose = random_pose(random, 0.3);
  const auto at = [&](double s) {  // 1.3 px and a little turning
    return Rigid3{exp_so3(Vector3(0, 0, 0.01 * s)) * pose.rotation,
                  pose.translation_mm + s * Vector3(0.4, 0.25, 0.1)};
  };
  const CameraRenderer renderer = renderer_of({one_tag(8)}, quiet());
  const int steps = renderer.sub_exposures(0, at(-0.5), at(0.5));
  EXPECT_GE(steps, 3);
  EXPECT_EQ(renderer.sub_exposures(0, at(0), at(0.01)), 1);
  BodyExposure exposure{at(0), {}};
  for (int k = 0; k < steps; ++k) exposure.path.push_back(at((k + 0.5) / steps - 0.5));
  const std::vector<float> fast = renderer.light({exposure});
  constexpr int kFine = 40;
  std::vector<double> mean(fast.size());
  for (int k = 0; k < kFine; ++k) {
    const std::vector<float> still = renderer.light({{at((k + 0.5) / kFine - 0.5), {}}});
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += double(still[i]) / kFine;
  }
  double worst = 0;
  for (std::size_t i = 0; i < mean.size(); ++i) worst = std::max(worst, std::abs(mean[i] - double(fast[i])));
  EXPECT_LT(worst, 3.0);  // of 190 grey levels of contrast
}

TEST(Renderer, SurfacesHideWhatIsBehindThem) {
  const Rigid3 pose{Matrix3(Vector3(1, -1, -1).asDiagonal()), Vector3(0, 0, 400)};
  const auto centre_and_corner = [&](double plate_distance_mm) {
    SceneBody body = one_tag(2), plate;
    film_test::add_plate(plate.surface, Rigid3{Matrix3::Identity(), Vector3(9, 9, 0)}, 8, 1);
    const Rigid3 plate_pose{pose.rotation, Vector3(0, 0, plate_distance_mm)};
    const auto light =
        renderer_of({body, plate}, quiet(), CameraModel{}).light({{pose, {}}, {plate_pose, {}}});
    // The upper right corner's white margin is at tag (11.2, 11.2) mm.
    const auto px = [&](double mm) { return int(std::lround(1100 * mm / 400)); };
    return std::pair(light[size_t(360 - px(11.2)) * 1280 + size_t(640 + px(11.2))],
                     light[size_t(360 - px(-11.2)) * 1280 + size_t(640 + px(-11.2))]);
  };
  const auto [behind, free_behind] = centre_and_corner(404);
  EXPECT_NEAR(behind, free_behind, 0.5) << "a plate behind the tag hides nothing";
  const auto [before, free_before] = centre_and_corner(395);
  EXPECT_LT(before, free_before - 30) << "a plate before it does";
  EXPECT_NEAR(free_before, free_behind, 0.5);
}

TEST(Renderer, NearTagsCoverFarOnesAndBacksAreNotDrawn) {
  SceneBody body = one_tag(2);
  body.tags.tags.push_back(film_test::tag_on(3, Rigid3{Matrix3::Identity(), Vector3(0, 0, 15)}));
  const Rigid3 pose{Matrix3(Vector3(1, -1, -1).asDiagonal()), Vector3(0, 0, 400)};
  const auto both = renderer_of({body}, quiet(), CameraModel{}).light({{pose, {}}});
  SceneBody near_only;
  near_only.tags.tags = {body.tags.tags[1]};
  const auto one = renderer_of({near_only}, quiet(), CameraModel{}).light({{pose, {}}});
  for (int y = 345; y < 375; ++y)
    for (int x = 625; x < 655; ++x)
      EXPECT_EQ(both[size_t(y) * 1280 + size_t(x)], one[size_t(y) * 1280 + size_t(x)]);
  const Rigid3 turned{Matrix3::Identity(), Vector3(0, 0, 400)};
  for (const float level : renderer_of({body}, quiet()).light({{turned, {}}})) ASSERT_NEAR(level, 110, 0.01);
}

TEST(Renderer, NoiseIsGaussianFreshAndReproducible) {
  RenderOptions options = quiet();
  options.noise_sigma = 2;
  options.seed = 77;
  const CameraRenderer renderer = renderer_of({}, options);
  const Image8 a = renderer.render({}, 5), again = renderer.render({}, 5), b = renderer.render({}, 6);
  EXPECT_EQ(a.pixels, again.pixels);
  double sum = 0, squares = 0, with_next = 0, with_below = 0, with_b = 0, beyond_two_sigma = 0;
  int n = 0;
  for (int y = 0; y < 719; ++y)
    for (int x = 0; x < 1279; ++x, ++n) {
      const double v = a.at(x, y) - 110.0;
      sum += v, squares += v * v;
      with_next += v * (a.at(x + 1, y) - 110.0), with_below += v * (a.at(x, y + 1) - 110.0);
      with_b += v * (b.at(x, y) - 110.0);
      beyond_two_sigma += std::abs(v) > 4.5;
    }
  EXPECT_NEAR(sum / n, 0, 0.02);
  EXPECT_NEAR(std::sqrt(squares / n), std::sqrt(4 + 1.0 / 12), 0.03);  // and rounding
  EXPECT_NEAR(beyond_two_sigma / n, std::erfc(2.25 / std::sqrt(2.0)), 0.004);
  for (const double product : {with_next, with_below, with_b}) EXPECT_LT(std::abs(product / squares), 0.01);
}

TEST(Renderer, CornersAreDarkerAndClutterIsBusy) {
  RenderOptions options;
  options.noise_sigma = 0;
  options.clutter = false;
  const auto plain = renderer_of({}, options).light({});
  EXPECT_NEAR(plain[360 * 1280 + 640], 110, 0.1);
  EXPECT_NEAR(plain[0] / plain[360 * 1280 + 640], 1 - options.vignetting, 0.005);
  options.clutter = true;
  for (const std::uint64_t seed : {1, 2, 3}) {
    options.seed = seed;
    const auto busy = renderer_of({}, options).light({});
    int edges = 0;
    for (std::size_t i = 0; i + 1 < busy.size(); ++i) edges += std::abs(busy[i + 1] - busy[i]) > 20;
    EXPECT_GT(edges, 4000);
  }
}

TEST(Renderer, RefusesUnknownTags) {
  SceneBody body = one_tag(2);
  body.tags.tags[0].id = 5000;
  EXPECT_FALSE(CameraRenderer::create(CameraModel{}, {body}, RenderOptions{}));
}

}  // namespace
}  // namespace gnathion
