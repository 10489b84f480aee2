#include "acquisition/replay.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/check.h"

namespace gnathion {

bool ClockWaiter::wait_until(HostTime time) {
  std::unique_lock lock(mutex_);
  while (!cancelled_) {
    const std::int64_t left_ns = time.ns - clock_.now().ns;
    if (left_ns <= 0) return true;
    // Asked again at least once a second: the clock may be set meanwhile.
    wake_.wait_for(lock, std::chrono::nanoseconds(std::min<std::int64_t>(left_ns, 1'000'000'000)));
  }
  return false;
}

void ClockWaiter::cancel() {
  std::lock_guard lock(mutex_);
  cancelled_ = true;
  wake_.notify_all();
}

PacedSource::PacedSource(std::unique_ptr<Source> source, Clock& clock, Waiter& waiter, double speed)
    : source_(std::move(source)), clock_(clock), waiter_(waiter), speed_(speed) {
  GNATHION_CHECK(speed > 0 && std::isfinite(speed));
}

Result<std::optional<Sample>> PacedSource::next() {
  GNATHION_TRY(std::optional<Sample> sample, source_->next());
  if (!sample) return sample;
  const HostTime arrival = header_of(*sample).arrival;
  if (!first_arrival_) {
    first_arrival_ = arrival;
    started_ = clock_.now();
  }
  const double behind_ns = static_cast<double>(arrival.ns - first_arrival_->ns) / speed_;
  if (!waiter_.wait_until({started_.ns + static_cast<std::int64_t>(behind_ns)}))
    return std::optional<Sample>();
  return sample;
}

}  // namespace gnathion
