// The way from the devices' threads to the writer, with the policy that session.h states.
#pragma once

#include <deque>

#include "core/bounded_queue.h"
#include "core/sample.h"

namespace gnathion {

/// Bytes that a sample holds in memory.
std::size_t memory_of(const Sample& sample);

using SampleQueue = BoundedQueue<Sample>;

/// One a device, used by its thread alone.
class SampleIntake {
 public:
  SampleIntake(SampleQueue& queue, std::size_t reserve_bytes) : queue_(queue), reserve_(reserve_bytes) {}
  /// Puts the sample or its ledger line into the queue. Waits only for scans.
  void put(Sample sample);
  /// The device has ended: lines that found no room go in now, whatever the wait.
  void finish();

 private:
  void reject(LedgerSample line);
  bool put_pending();
  SampleQueue& queue_;
  std::size_t reserve_;
  /// Lines for which even the reserve had no room, oldest first; lines of consecutive counters with one fate
  /// and reason are one.
  std::deque<LedgerSample> pending_;
};

}  // namespace gnathion
