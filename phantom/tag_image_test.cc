#include "phantom/tag_image.h"

#include <gtest/gtest.h>

namespace gnathion {
namespace {

int differing_data_bits(const TagImage& a, const TagImage& b, int quarter_turns) {
  int count = 0;
  for (int row = 2; row < 8; ++row)
    for (int column = 2; column < 8; ++column) {
      int r = row, c = column;
      for (int k = 0; k < quarter_turns; ++k) {
        const int old = r;
        r = c;
        c = 9 - old;
      }
      count += a.is_white(column, row) != b.is_white(c, r);
    }
  return count;
}

TEST(TagImage, HasAWhiteRingAndABlackRing) {
  const auto tag = tag_image("tag36h11", 17);
  ASSERT_TRUE(tag) << tag.error().line();
  EXPECT_EQ(tag->modules, 10);
  EXPECT_EQ(tag->border_modules, 1);
  EXPECT_EQ(tag->square_modules(), 8);
  for (int i = 0; i < 10; ++i) {
    for (const int edge : {0, 9}) EXPECT_TRUE(tag->is_white(i, edge) && tag->is_white(edge, i));
    if (i == 0 || i == 9) continue;
    for (const int edge : {1, 8}) EXPECT_FALSE(tag->is_white(i, edge) || tag->is_white(edge, i));
  }
  EXPECT_TRUE(tag->is_white(-3, 4)) << "the stock around the print is white";
}

TEST(TagImage, TagsDifferByTheFamilysDistanceInEveryRotation) {
  std::vector<TagImage> tags;
  for (const int id : {0, 1, 2, 5, 100, 101, 350, 586}) tags.push_back(tag_image("tag36h11", id).value());
  for (std::size_t i = 0; i < tags.size(); ++i)
    for (std::size_t j = 0; j < tags.size(); ++j)
      for (int turn = 0; turn < 4; ++turn)
        if (i != j || turn != 0) {
          EXPECT_GE(differing_data_bits(tags[i], tags[j], turn), 11);
        }
}

TEST(TagImage, RefusesWhatDoesNotExist) {
  for (const auto& refused : {tag_image("tag36h11", 587), tag_image("tag36h11", -1), tag_image("qr", 0)}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kInput);
  }
}

}  // namespace
}  // namespace gnathion
