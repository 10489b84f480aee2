#include "anatomy/xray.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kSoft = 50.0, kBone = 1200.0, kWater = 0.0206;
constexpr double kHalf = 6.0;  // of the cube that moves

/// 60 mm of soft tissue in air, a slab of bone at the top that stays and a cube of bone below it that moves.
Volume head(double spacing) {
  Volume v;
  const int n = static_cast<int>(std::lround(80.0 / spacing));
  v.grid.size = {n, n, n};
  v.grid.step_mm = spacing * Matrix3::Identity();
  v.grid.origin_mm = Vector3::Constant(-0.5 * spacing * (n - 1));
  v.voxels16.resize(v.grid.count());
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const Vector3 p = v.grid.frame_from_voxel(Vector3(i, j, k));
        const double r = p.cwiseAbs().maxCoeff();
        const bool cube = r < kHalf, slab = r < 30.0 && p.z() > 10.0 && p.z() < 14.0;
        v.voxels16[v.grid.index(i, j, k)] = static_cast<std::int16_t>(cube || slab ? kBone
                                                                      : r < 30.0   ? kSoft
                                                                                   : -1000.0);
      }
  return v;
}

Box around(double half) {
  Box box;
  box.extend(Vector3::Constant(-half));
  box.extend(Vector3::Constant(half));
  return box;
}

double at(const XrayFilm& film, const XrayOptions& o, double right_mm, double up_mm) {
  const double pitch = o.field_mm / o.size_px, middle = 0.5 * (o.size_px - 1);
  const int x = static_cast<int>(std::lround(middle + right_mm / pitch));
  const int y = static_cast<int>(std::lround(middle - up_mm / pitch));
  return film.integral[static_cast<std::size_t>(y) * static_cast<std::size_t>(o.size_px) +
                       static_cast<std::size_t>(x)];
}

class CubeInTissue : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto found = mandible_from_bone(volume, 600.0, {{0, 0, 5.5}}, {{0, 0, 12.0}}, around(25.0));
    ASSERT_TRUE(found) << found.error().line();
    mask = *found;
  }
  Result<JointXray> ray(const char* view) {
    return JointXray::create(volume, Transform<Cbct, Dental>(), mask, Vector3::Zero(),
                             *named_view(view, arch), options);
  }
  static double mu(double value) { return kWater * (1.0 + value / 1000.0); }
  ArchFrame arch;  // left x, anterior −y, up z
  Volume volume = head(0.5);
  VoxelMask mask;
  XrayOptions options{.size_px = 96, .field_mm = 48.0, .depth_mm = 50.0};
};

TEST_F(CubeInTissue, TheMaskIsTheCubeAndItsRim) {
  const double cube = std::pow(2 * kHalf / 0.5, 3), with_rim = std::pow(2 * kHalf / 0.5 + 2, 3);
  EXPECT_GE(static_cast<double>(mask.count()), cube);
  EXPECT_LE(static_cast<double>(mask.count()), with_rim);
  EXPECT_FALSE(mandible_from_bone(volume, 600.0, {{20, 20, -20}}, {}, around(25.0))) << "no bone there";
  EXPECT_FALSE(mandible_from_bone(volume, 600.0, {{0, 0, 5.5}}, {{1, 1, 1}}, around(25.0)))
      << "the same piece";
}

TEST_F(CubeInTissue, LineIntegralsAreThoseOfBeerAndLambert) {
  const auto xray = ray("frontal");
  ASSERT_TRUE(xray) << xray.error().line();
  const XrayFilm film = xray->film({});
  const double soft = mu(kSoft) * 50.0;
  EXPECT_NEAR(at(film, options, 15.0, 0.0), soft, 0.01 * soft);
  EXPECT_NEAR(at(film, options, 0.0, 0.0), soft + (mu(kBone) - mu(kSoft)) * 2 * kHalf, 0.02 * soft);
  EXPECT_NEAR(at(film, options, 0.0, 12.0), mu(kBone) * 50.0, 0.01 * soft);
  EXPECT_NEAR(at(xray->resting(), options, 0.0, 0.0), soft, 0.01 * soft) << "tissue fills the hole";
}

TEST_F(CubeInTissue, InMiTheTwoPartsAreTheVolume) {
  for (const char* view : {"lateral", "frontal", "towne", "submentovertex"}) {
    const auto xray = ray(view);
    ASSERT_TRUE(xray) << xray.error().line();
    const XrayFilm sum = xray->film({}), whole = xray->scanned();
    double worst = 0.0;
    for (std::size_t i = 0; i < sum.integral.size(); ++i)
      worst = std::max(worst, static_cast<double>(std::abs(sum.integral[i] - whole.integral[i])));
    EXPECT_LT(worst, 1e-4) << view;
  }
}

TEST_F(CubeInTissue, TheCubeMovesAsTheJawDoes) {
  const auto xray = ray("lateral");  // right on the film is anterior
  ASSERT_TRUE(xray) << xray.error().line();
  const XrayFilm mi = xray->film({});
  const XrayFilm forward = xray->film(Motion<Dental>(Rigid3::from_translation({0, -4.0, -3.0})));
  const double soft = mu(kSoft) * 50.0, cube = soft + (mu(kBone) - mu(kSoft)) * 2 * kHalf;
  EXPECT_NEAR(at(mi, options, 9.0, 0.0), soft, 0.01 * soft);
  EXPECT_NEAR(at(forward, options, 9.0, -3.0), cube, 0.02 * soft) << "forwards and down";
  EXPECT_NEAR(at(forward, options, -5.0, 4.0), soft, 0.01 * soft) << "where it was";
  EXPECT_NEAR(at(forward, options, 0.0, 12.0), at(mi, options, 0.0, 12.0), 1e-6) << "the rest stays";
  // To the side, along the beam, nothing changes.
  const XrayFilm aside = xray->film(Motion<Dental>(Rigid3::from_translation({3.0, 0, 0})));
  EXPECT_NEAR(at(aside, options, 0.0, 0.0), at(mi, options, 0.0, 0.0), 0.01 * soft);
}

TEST_F(CubeInTissue, WhatWasScannedOutOfMiIsBroughtBack) {
  const Motion<Dental> scanned(Rigid3::from_translation({0, 2.0, -1.0}));
  const auto xray = JointXray::create(volume, Transform<Cbct, Dental>(), mask, Vector3::Zero(),
                                      *named_view("lateral", arch), options, scanned);
  ASSERT_TRUE(xray) << xray.error().line();
  const XrayFilm as_scanned = xray->film(scanned), whole = xray->scanned();
  for (std::size_t i = 0; i < whole.integral.size(); i += 17)
    ASSERT_NEAR(as_scanned.integral[i], whole.integral[i], 1e-4);
  const double soft = mu(kSoft) * 50.0;
  EXPECT_NEAR(at(xray->film({}), options, 7.0, 0.0), soft + (mu(kBone) - mu(kSoft)) * 2 * kHalf, 0.03 * soft);
}

TEST_F(CubeInTissue, TheVolumeMayLieAnywhere) {
  Random random(11);
  const Rigid3 x{random.rotation(), 30.0 * random.normal3()};
  Volume moved = volume;  // the same voxels, told in another frame, with oblique axes
  moved.grid.step_mm = x.rotation * volume.grid.step_mm;
  moved.grid.origin_mm = x * volume.grid.origin_mm;
  const auto here = ray("towne");
  const auto there = JointXray::create(moved, Transform<Cbct, Dental>(x), mask, Vector3::Zero(),
                                       *named_view("towne", arch), options);
  ASSERT_TRUE(here && there);
  const Motion<Dental> motion(Rigid3::about_axis({20, 30, 10}, {1, 0.2, 0}, 0.1));
  const XrayFilm a = here->film(motion), b = there->film(motion);
  for (std::size_t i = 0; i < a.integral.size(); ++i) ASSERT_NEAR(a.integral[i], b.integral[i], 1e-3);
}

TEST_F(CubeInTissue, AFocusMagnifies) {
  options.source_mm = 150.0;
  const auto near = ray("frontal");
  ASSERT_TRUE(near) << near.error().line();
  const double soft = mu(kSoft) * 50.0;
  // The cube's far face, 6 mm behind the joint's plane, is drawn smaller than the near one: its edge at 6 mm
  // is shown at 6·150/144 = 6.25 mm for the face that is nearer to the focus.
  EXPECT_GT(at(near->film({}), options, 6.1, 0.0), at(near->film({}), options, 9.0, 0.0) + 0.01 * soft);
  EXPECT_NEAR(at(near->film({}), options, 0.0, 0.0), soft + (mu(kBone) - mu(kSoft)) * 2 * kHalf, 0.02 * soft);
}

TEST_F(CubeInTissue, ImpossibleFilmsAreRefused) {
  EXPECT_FALSE(named_view("nowhere", arch));
  options.source_mm = 10.0;
  EXPECT_FALSE(ray("frontal"));
  options.source_mm = 0.0;
  options.size_px = 1;
  EXPECT_FALSE(ray("frontal"));
  options.size_px = 64;
  const auto beyond = JointXray::create(volume, Transform<Cbct, Dental>(), mask, Vector3(200, 0, 0),
                                        *named_view("frontal", arch), options);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().code, ErrorCode::kInput);
}

TEST(XrayWindow, BoneIsWhite) {
  XrayFilm film{10, std::vector<float>(100)};
  for (std::size_t i = 0; i < 100; ++i) film.integral[i] = static_cast<float>(i);
  const XrayWindow w = window_of(film);
  const Image8 image = windowed(film, w.low, w.high);
  EXPECT_EQ(image.at(0, 0), 0);
  EXPECT_EQ(image.at(9, 9), 255);
  EXPECT_NEAR(image.at(0, 5), 127, 4);
}

}  // namespace
}  // namespace gnathion
