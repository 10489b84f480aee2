#include "phantom/tooth.h"

#include <cmath>
#include <map>
#include <utility>

#include <gtest/gtest.h>

namespace gnathion {
namespace {

/// Local maxima of the occlusal surface on a fine grid that stand out of their surroundings within 0.9 mm.
int count_cusps(const Crown& crown) {
  constexpr double kStep = 0.2;
  constexpr int kHalf = 32;
  std::map<std::pair<int, int>, double> heights;
  for (int x = -kHalf; x <= kHalf; ++x) {
    for (int y = -kHalf; y <= kHalf; ++y) {
      const double w = crown.surface_from_above_mm(x * kStep, y * kStep).z();
      heights[{x, y}] = std::isnan(w) ? -1.0 : w;
    }
  }
  int cusps = 0;
  for (int x = 4 - kHalf; x <= kHalf - 4; ++x) {
    for (int y = 4 - kHalf; y <= kHalf - 4; ++y) {
      const double here = heights[{x, y}];
      if (here < 0.83 * crown.form().height_mm) continue;  // not the knots of the marginal ridges
      bool highest = true;
      for (int i = -4; i <= 4 && highest; ++i) {
        for (int j = -4; j <= 4 && highest; ++j) {
          if (i * i + j * j > 20 || (i == 0 && j == 0)) continue;
          const double other = heights[{x + i, y + j}];
          if (other > here || (other == here && (i < 0 || (i == 0 && j < 0)))) highest = false;
        }
      }
      if (highest) ++cusps;
    }
  }
  return cusps;
}

TEST(Tooth, CuspsAreInTheRightNumber) {
  EXPECT_EQ(count_cusps(Crown(upper_tooth_form(3))), 1);
  EXPECT_EQ(count_cusps(Crown(upper_tooth_form(4))), 2);
  EXPECT_EQ(count_cusps(Crown(upper_tooth_form(5))), 2);
  EXPECT_EQ(count_cusps(Crown(upper_tooth_form(6))), 4);
  EXPECT_EQ(count_cusps(Crown(upper_tooth_form(7))), 4);
  EXPECT_EQ(count_cusps(Crown(lower_tooth_form(5))), 3);
  EXPECT_EQ(count_cusps(Crown(lower_tooth_form(6))), 5);
  EXPECT_EQ(count_cusps(Crown(lower_tooth_form(7))), 4);
}

/// How far the crown reaches at height w in direction (du, dv) from its axis.
double reach(const Crown& crown, double w, double du, double dv) {
  double inside = 0.0, outside = 9.0;
  for (int i = 0; i < 30; ++i) {
    const double middle = 0.5 * (inside + outside);
    (crown.body_distance_mm({middle * du, middle * dv, w}) > 0 ? outside : inside) = middle;
  }
  return inside;
}

TEST(Tooth, SizesAgreeWithWheeler) {
  // Mesiodistal and buccolingual diameters of the crown.
  const double upper[7][2] = {{8.5, 7.0}, {6.5, 6.0},   {7.5, 8.0}, {7.0, 9.0},
                              {7.0, 9.0}, {10.0, 11.0}, {9.0, 11.0}};
  const double lower[7][2] = {{5.0, 6.0}, {5.5, 6.5},   {7.0, 7.5},  {7.0, 7.5},
                              {7.0, 8.0}, {11.0, 10.5}, {10.5, 10.0}};
  for (int n = 1; n <= 7; ++n) {
    for (const bool is_upper : {true, false}) {
      const ToothForm f = is_upper ? upper_tooth_form(n) : lower_tooth_form(n);
      const Crown crown(f);
      double mesiodistal = 0.0, buccal = 0.0, lingual = 0.0;
      for (double w = 0.5; w < 0.95 * f.height_mm; w += 0.1) {
        double most_mesial = 0.0, most_distal = 0.0;
        for (double v = -3.0; v <= 3.0; v += 0.5) {
          if (crown.body_distance_mm({0.0, v, w}) > 0.0) continue;
          double u = 0.0;
          while (crown.body_distance_mm({u, v, w}) < 0.0) u += 0.02;
          most_mesial = std::max(most_mesial, u);
          u = 0.0;
          while (crown.body_distance_mm({-u, v, w}) < 0.0) u += 0.02;
          most_distal = std::max(most_distal, u);
        }
        mesiodistal = std::max(mesiodistal, most_mesial + most_distal);
        if (w < 0.6 * f.height_mm) {
          buccal = std::max(buccal, reach(crown, w, 0, 1));
          lingual = std::max(lingual, reach(crown, w, 0, -1));
        }
      }
      const double* expected = is_upper ? upper[n - 1] : lower[n - 1];
      EXPECT_NEAR(mesiodistal, expected[0], 0.8) << (is_upper ? "upper " : "lower ") << n;
      EXPECT_NEAR(buccal + lingual, expected[1], 0.8) << (is_upper ? "upper " : "lower ") << n;
    }
  }
}

TEST(Tooth, HeightOfContourHasAnUndercutBelow) {
  for (int n = 1; n <= 7; ++n) {
    for (const ToothForm& f : {upper_tooth_form(n), lower_tooth_form(n)}) {
      const Crown crown(f);
      for (const double side : {1.0, -1.0}) {
        double widest = 0.0, at = 0.0;
        for (double w = 0.0; w < 0.9 * f.height_mm; w += 0.1) {
          const double r = reach(crown, w, 0, side);
          if (r > widest) widest = r, at = w;
        }
        EXPECT_GT(at, 0.08 * f.height_mm) << n;
        EXPECT_LT(at, 0.62 * f.height_mm) << n;
        EXPECT_GT(widest - reach(crown, 0.0, 0, side), 0.2) << n;
      }
      // Neighbours touch in the occlusal half; the neck is at least a tenth narrower.
      double widest = 0.0, at = 0.0;
      for (double w = 0.0; w < 0.95 * f.height_mm; w += 0.1) {
        const double r = reach(crown, w, 1, 0);
        if (r > widest) widest = r, at = w;
      }
      EXPECT_GT(at, 0.4 * f.height_mm) << n;
      EXPECT_LT(reach(crown, 0.0, 1, 0), 0.9 * widest) << n;
    }
  }
}

TEST(Tooth, IncisorsAreShovelsWithACingulum) {
  const Crown crown(upper_tooth_form(1));
  const double h = crown.form().height_mm;
  const auto lingual = [&](double u, double w) {
    double v = 3.0;
    while (crown.distance_mm({u, v, w}) > 0.0) v -= 0.01;
    while (crown.distance_mm({u, v, w}) < 0.0) v -= 0.01;
    return v;
  };
  // The fossa lies deeper than the marginal ridges beside it, and the cingulum stands out below it.
  EXPECT_GT(lingual(0.0, 0.6 * h) - lingual(2.9, 0.6 * h), 0.3);
  EXPECT_GT(lingual(0.0, 0.6 * h) - lingual(-2.9, 0.6 * h), 0.3);
  EXPECT_GT(lingual(0.0, 0.5 * h) - lingual(0.0, 0.2 * h), 1.5);
}

TEST(Tooth, ScalingScalesTheCrown) {
  const Crown plain(lower_tooth_form(6)), big(scaled(lower_tooth_form(6), {1.1, 1.05, 1.2}));
  EXPECT_NEAR(reach(big, 0.5 * big.form().height_mm, 1, 0),
              1.1 * reach(plain, 0.5 * plain.form().height_mm, 1, 0), 1e-6);
  EXPECT_NEAR(big.surface_from_above_mm(0, 0).z() - plain.surface_from_above_mm(0, 0).z(),
              0.2 * plain.form().height_mm, 0.1);
}

}  // namespace
}  // namespace gnathion
