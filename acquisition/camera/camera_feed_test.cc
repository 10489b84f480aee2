#include "acquisition/camera/camera_feed.h"

#include <gtest/gtest.h>

#include <thread>

namespace gnathion {
namespace {

FrameSample frame(std::uint32_t sequence) {
  FrameSample sample;
  sample.header.stream = "camera_0";
  sample.header.sequence = sequence;
  return sample;
}

TEST(CameraFeed, WhatWasInHandAtTheStopIsStillGiven) {
  CameraFeed feed("camera_0", 1, CameraFeed::WhenFull::kReject);
  feed.stop();
  std::thread camera([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the consumer waits by then, or does not
    feed.deliver(frame(0));
    feed.account({frame(1).header, LedgerSample::Fate::kMissing, 2, "counter gap"});
    feed.end();
  });
  const auto first = feed.next();
  const auto second = feed.next();
  const auto last = feed.next();
  camera.join();
  ASSERT_TRUE(first && *first && second && *second && last);
  EXPECT_TRUE(std::holds_alternative<FrameSample>(**first));
  ASSERT_TRUE(std::holds_alternative<LedgerSample>(**second));
  EXPECT_EQ(std::get<LedgerSample>(**second).count, 2u);
  EXPECT_FALSE(*last);
}

TEST(CameraFeed, ACameraThatHangsDoesNotHoldUpTheStop) {
  CameraFeed feed("camera_0", 1, CameraFeed::WhenFull::kReject);
  feed.stop();
  const auto nothing = feed.next();  // end() never comes
  ASSERT_TRUE(nothing);
  EXPECT_FALSE(*nothing);
}

}  // namespace
}  // namespace gnathion
