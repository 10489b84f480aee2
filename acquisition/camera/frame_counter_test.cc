#include "acquisition/camera/frame_counter.h"

#include <gtest/gtest.h>

#include "core/random.h"

namespace gnathion {
namespace {

TEST(FrameCounter, NumbersFromZeroWhereverTheCameraStarts) {
  FrameCounter counter;
  EXPECT_EQ(counter.take(4711).sequence, 0u);
  EXPECT_EQ(counter.take(4712).sequence, 1u);
  const auto place = counter.take(4716);
  EXPECT_EQ(place.sequence, 5u);
  EXPECT_EQ(place.missing, 3u);
}

TEST(FrameCounter, ARepeatedNumberIsNotANewOne) {
  FrameCounter counter;
  counter.take(10);
  counter.take(11);
  EXPECT_TRUE(counter.take(11).repeated);
  EXPECT_TRUE(counter.take(10).repeated);
  const auto place = counter.take(12);
  EXPECT_FALSE(place.repeated);
  EXPECT_EQ(place.sequence, 2u);
  EXPECT_EQ(place.missing, 0u);
}

TEST(FrameCounter, WrapsAsGigEVisionDoesWhileFramesAreLost) {
  Random random(3);
  FrameCounter counter;
  std::uint64_t sent = 0, accounted = 0;
  std::uint32_t last = 0;
  while (sent < 300000) {
    const std::uint64_t step = 1 + random.below(200) / 199 * random.below(500);  // rarely, many lost
    sent += step;
    const auto place = counter.take((sent - 1) % 65535 + 1);
    ASSERT_FALSE(place.repeated);
    accounted += accounted == 0 ? step : place.missing + 1;
    last = place.sequence;
  }
  EXPECT_EQ(accounted, sent);
  EXPECT_GT(last, 200000u);
}

TEST(FrameCounter, GoesOnAfterTheCameraStartedAgain) {
  FrameCounter counter;
  counter.take(500);
  counter.take(501);
  counter.restart();
  const auto place = counter.take(1);
  EXPECT_EQ(place.sequence, 2u);
  EXPECT_EQ(place.missing, 0u);
}

TEST(FrameCounter, AFrameWithoutNumberTakesThePlaceOfTheNext) {
  FrameCounter counter;
  EXPECT_EQ(counter.take_unnumbered().sequence, 0u);
  EXPECT_EQ(counter.take(65534).sequence, 1u);
  EXPECT_EQ(counter.take_unnumbered().sequence, 2u);  // 65535
  EXPECT_EQ(counter.take_unnumbered().sequence, 3u);  // 1
  const auto place = counter.take(4);
  EXPECT_EQ(place.missing, 2u);
  EXPECT_EQ(place.sequence, 6u);
  EXPECT_TRUE(counter.take(65520).repeated);  // from before the wrap, not 65515 frames ahead
}

TEST(FrameCounter, CountsForCamerasThatDoNot) {
  FrameCounter counter;
  EXPECT_EQ(counter.take_next(0).sequence, 0u);
  EXPECT_EQ(counter.take_next(2).sequence, 3u);
}

}  // namespace
}  // namespace gnathion
