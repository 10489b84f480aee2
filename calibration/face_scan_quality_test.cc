#include "calibration/face_scan_quality.h"

#include <gtest/gtest.h>

#include "calibration/chain_json.h"

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

ResidualNoise noise_of(double white_mm, double correlated_mm) {
  ResidualNoise noise;
  noise.models.push_back({1.0, white_mm, correlated_mm, 10.0, false});
  return noise;
}

TEST(FaceScanQuality, ErrorsGrowWithTheLeverToTheTeeth) {
  // 1 mrad about x alone: a tooth 100 mm along y moves by 0.1 mm, one on the axis stays.
  Matrix6 covariance = Matrix6::Zero();
  covariance(0, 0) = 1e-6;
  const auto far = face_scan_quality(noise_of(0.3, 0.4), covariance, {{50, 100, 0}});
  EXPECT_NEAR(far.at_teeth_mm, 0.1, 1e-12);
  EXPECT_NEAR(far.deviation_mm, 0.5, 1e-12);
  EXPECT_NEAR(face_scan_quality(noise_of(0.3, 0.4), covariance, {{50, 0, 0}}).at_teeth_mm, 0, 1e-12);
  // RMS over both.
  EXPECT_NEAR(face_scan_quality(noise_of(0, 0), covariance, {{0, 100, 0}, {0, 0, 0}}).at_teeth_mm,
              0.1 / std::sqrt(2.0), 1e-12);
}

TEST(FaceScanQuality, SaysByNameWhatIsTooCoarse) {
  EXPECT_FALSE(too_coarse("face scan in MI", {0.08, 0.099}));
  const auto warning = too_coarse("face scan in MI", {0.8, 0.3});
  ASSERT_TRUE(warning);
  EXPECT_EQ(*warning,
            "face scan in MI too coarse for T_F: deviation 0.80 mm gives 0.30 mm at the teeth, 0.10 allowed");
  EXPECT_TRUE(too_coarse("face scan in MI", {0.8, std::nan("")}));
}

TEST(FaceScanQuality, StandsInChainJson) {
  Chain chain;
  chain.face_mi = {0.8, 0.3};
  chain.face_tp = {0.05, 0.02};
  chain.warnings = {*too_coarse("face scan in MI", chain.face_mi)};
  const nlohmann::json j = chain_json(chain);
  const auto back = chain_from_json(j, "chain.json");
  ASSERT_TRUE(back) << back.error().line();
  EXPECT_EQ(back->warnings, chain.warnings);
  EXPECT_EQ(back->face_mi.deviation_mm, 0.8);
  EXPECT_EQ(back->face_tp.at_teeth_mm, 0.02);
}

}  // namespace
}  // namespace gnathion
