#include "acquisition/camera/natural_order.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/random.h"

namespace gnathion {
namespace {

TEST(NaturalOrder, NumbersCompareAsNumbers) {
  std::vector<std::string> names = {"f10.png", "f9.png", "f1.png",  "f02.png",
                                    "a.png",   "f2.png", "f1b.png", "f99999999999999999999.png"};
  std::sort(names.begin(), names.end(), natural_less);
  EXPECT_EQ(names, (std::vector<std::string>{"a.png", "f1.png", "f1b.png", "f2.png", "f02.png", "f9.png",
                                             "f10.png", "f99999999999999999999.png"}));
}

TEST(NaturalOrder, IsAnOrder) {
  Random random(1);
  std::vector<std::string> names;
  for (int i = 0; i < 60; ++i) {
    std::string name;
    for (std::uint32_t n = random.below(7); n > 0; --n) name += "01a.\xc3"[random.below(5)];
    names.push_back(name);
  }
  for (const auto& a : names)
    for (const auto& b : names) {
      EXPECT_FALSE(natural_less(a, b) && natural_less(b, a)) << a << " " << b;
      EXPECT_TRUE(a == b || natural_less(a, b) || natural_less(b, a)) << a << " " << b;
      for (const auto& c : names)
        EXPECT_TRUE(!(natural_less(a, b) && natural_less(b, c)) || natural_less(a, c))
            << a << " " << b << " " << c;
    }
}

TEST(NaturalOrder, RunningNumbersOnlyWhereTheyAre) {
  using Numbers = std::vector<std::uint64_t>;
  EXPECT_EQ(frame_numbers({"f7.png", "f8.png", "f10.png"}), (Numbers{7, 8, 10}));
  EXPECT_EQ(frame_numbers({"left_2_007.tif", "left_2_008.tif"}), (Numbers{7, 8}));
  EXPECT_EQ(frame_numbers({"5.png"}), (Numbers{5}));
  EXPECT_FALSE(frame_numbers({"a.png", "b.png"}));
  EXPECT_FALSE(frame_numbers({"a1.png", "b2.png"}));     // two series
  EXPECT_FALSE(frame_numbers({"f1.png", "f01.png"}));    // one number twice
  EXPECT_FALSE(frame_numbers({"f1.png", "f1000.png"}));  // times, not numbers
  EXPECT_FALSE(frame_numbers({"20240101120000000000.png"}));
  EXPECT_FALSE(frame_numbers({}));
}

}  // namespace
}  // namespace gnathion
