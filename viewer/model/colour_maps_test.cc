// What the maps and palettes are for eyes without red or green cones: simulated after Machado, Oliveira &
// Fernandes 2009 (full dichromacy), compared in CIELAB.
#include "viewer/model/colour_maps.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rendering/charts.h"

namespace gnathion {
namespace {

using Eyes = Matrix3;
Eyes normal() {
  return Matrix3::Identity();
}
Eyes protanopia() {
  return (Matrix3() << 0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116,
          1.051998)
      .finished();
}
Eyes deuteranopia() {
  return (Matrix3() << 0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.011820, 0.042940,
          0.968881)
      .finished();
}

/// CIELAB (D65) of an sRGB colour as those eyes see it.
Vector3 lab(const Color& color, const Eyes& eyes) {
  Vector3 linear;
  for (int i = 0; i < 3; ++i) {
    const double v = color[static_cast<std::size_t>(i)];
    linear[i] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  }
  linear = (eyes * linear).cwiseMax(0.0).cwiseMin(1.0);
  Matrix3 xyz_from_rgb;
  xyz_from_rgb << 0.4124564, 0.3575761, 0.1804375, 0.2126729, 0.7151522, 0.0721750, 0.0193339, 0.1191920,
      0.9503041;
  const Vector3 xyz = (xyz_from_rgb * linear).cwiseQuotient(Vector3(0.95047, 1, 1.08883));
  const auto f = [](double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116; };
  return {116 * f(xyz.y()) - 16, 500 * (f(xyz.x()) - f(xyz.y())), 200 * (f(xyz.y()) - f(xyz.z()))};
}

double least_difference(const std::vector<Color>& colors, const Eyes& eyes) {
  double least = 1e9;
  for (std::size_t i = 0; i < colors.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      least = std::min(least, (lab(colors[i], eyes) - lab(colors[k], eyes)).norm());
  return least;
}

TEST(ColourBlindness, MapsRiseEvenlyInLightness) {
  for (const Eyes& eyes : {normal(), protanopia(), deuteranopia()}) {
    for (int i = 0; i < 64; ++i)
      EXPECT_GT(lab(ramp_color((i + 1) / 64.0), eyes).x(), lab(ramp_color(i / 64.0), eyes).x() + 0.3) << i;
    // Of a signed map both arms fall from the middle, and arms of opposite sign are two colours.
    for (int i = 0; i < 32; ++i)
      for (const double side : {-1.0, 1.0})
        EXPECT_LT(lab(diverging_color(side * (i + 1) / 32.0), eyes).x(),
                  lab(diverging_color(side * i / 32.0), eyes).x() - 0.3)
            << side * i;
    for (int i = 4; i <= 32; ++i)
      EXPECT_GT((lab(diverging_color(i / 32.0), eyes) - lab(diverging_color(-i / 32.0), eyes)).norm(), 20)
          << i / 32.0;
  }
}

/// A difference of 10 is plain to see side by side; of 2.3 just so.
TEST(ColourBlindness, CategoriesStayApart) {
  using namespace safe_palette;
  const std::vector<Color> charts = {kBlue, kOrange, kGreen, kVermilion, kPurple, kSky, kGrey};
  const std::vector<Color> profiles = {palette::kMaxilla, palette::kMandible,   palette::kInner,
                                       palette::kOuter,   palette::kOcclusalTp, palette::kSplint};
  for (const auto& [name, eyes] :
       {std::pair{"all cones", normal()}, {"protanopia", protanopia()}, {"deuteranopia", deuteranopia()}}) {
    const double of_charts = least_difference(charts, eyes), of_profiles = least_difference(profiles, eyes);
    std::printf("%s: least difference %.1f in charts, %.1f in profiles\n", name, of_charts, of_profiles);
    EXPECT_GT(of_charts, 10.0) << name;
    EXPECT_GT(of_profiles, 10.0) << name;
  }
  // The test can fail: red and green of the same lightness.
  EXPECT_LT(least_difference({{0.75, 0.35, 0.30}, {0.48, 0.50, 0.29}}, deuteranopia()), 10.0);
}

/// "Not measured" is no value of a map.
TEST(ColourBlindness, GreyIsNoValue) {
  for (const Eyes& eyes : {normal(), protanopia(), deuteranopia()})
    for (int i = -32; i <= 32; ++i) {
      EXPECT_GT((lab(diverging_color(i / 32.0), eyes) - lab(kNotMeasured, eyes)).norm(), 10) << i / 32.0;
    }
}

}  // namespace
}  // namespace gnathion
