#include "acquisition/replay.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace gnathion {
namespace {

class ListSource : public Source {
 public:
  explicit ListSource(std::vector<std::int64_t> arrivals_ns) : arrivals_ns_(std::move(arrivals_ns)) {}
  Result<std::optional<Sample>> next() override {
    if (at_ == arrivals_ns_.size()) return std::optional<Sample>();
    const auto sequence = static_cast<std::uint32_t>(at_);
    return std::optional<Sample>(EventSample{
        {"pedal", sequence, {arrivals_ns_[at_] - 3}, {arrivals_ns_[at_++]}, {9}}, "MI", true, ""});
  }

 private:
  std::vector<std::int64_t> arrivals_ns_;
  std::size_t at_ = 0;
};

/// Sets the clock to what is waited for, and remembers it.
class JumpingWaiter : public Waiter {
 public:
  explicit JumpingWaiter(ManualClock& clock) : clock_(clock) {}
  bool wait_until(HostTime time) override {
    waits.push_back(time.ns);
    if (clock_.now() < time) clock_.set(time);
    return !cancelled;
  }
  std::vector<std::int64_t> waits;
  bool cancelled = false;

 private:
  ManualClock& clock_;
};

TEST(PacedSource, SamplesComeUnchangedAtTheirPace) {
  for (const double speed : {1.0, 4.0, 0.5}) {
    ManualClock clock({1000});
    JumpingWaiter waiter(clock);
    PacedSource source(std::make_unique<ListSource>(std::vector<std::int64_t>{500, 900, 2500}), clock, waiter,
                       speed);
    for (const std::int64_t arrival : {500, 900, 2500}) {
      const auto sample = source.next();
      ASSERT_TRUE(sample && *sample);
      EXPECT_EQ(header_of(**sample).arrival.ns, arrival);
      EXPECT_EQ(header_of(**sample).capture.ns, arrival - 3);
      EXPECT_EQ(clock.now().ns, 1000 + static_cast<std::int64_t>(static_cast<double>(arrival - 500) / speed));
    }
    EXPECT_FALSE(source.next()->has_value());
  }
}

TEST(PacedSource, EndsWhenCancelled) {
  ManualClock clock;
  JumpingWaiter waiter(clock);
  waiter.cancelled = true;
  PacedSource source(std::make_unique<ListSource>(std::vector<std::int64_t>{1, 2}), clock, waiter);
  EXPECT_FALSE(source.next()->has_value());
}

TEST(ClockWaiter, WaitsOnItsClockAndCanBeCancelled) {
  SystemClock clock;
  ClockWaiter waiter(clock);
  const HostTime soon{clock.now().ns + 20'000'000};
  EXPECT_TRUE(waiter.wait_until(soon));
  EXPECT_GE(clock.now(), soon);
  std::thread canceller([&] { waiter.cancel(); });
  EXPECT_FALSE(waiter.wait_until({clock.now().ns + 3'600'000'000'000}));
  canceller.join();
  EXPECT_FALSE(waiter.wait_until({0}));
}

}  // namespace
}  // namespace gnathion
