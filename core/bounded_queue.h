// A queue between threads that never grows past its capacity and never drops silently.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

#include "core/check.h"

namespace gnathion {

/// Multi-producer, multi-consumer. All members are thread-safe. The capacity counts items, or, where a cost
/// is given with each, whatever the costs count (bytes). An item that costs more than the capacity is taken
/// by an empty queue.
template <class T>
class BoundedQueue {
 public:
  explicit BoundedQueue(std::size_t capacity) : capacity_(capacity) { GNATHION_CHECK(capacity > 0); }

  /// Waits for room. False when the queue is closed: the value was not taken.
  bool push(T value, std::size_t cost = 1) {
    std::unique_lock lock(mutex_);
    room_.wait(lock, [&] { return closed_ || fits(cost, 0); });
    if (closed_) return false;
    take(std::move(value), cost);
    return true;
  }

  /// Never waits. False when full or closed: the caller accounts for the value, which is untouched.
  /// `reserve`: how far beyond the capacity this item may go.
  bool try_push(T& value, std::size_t cost = 1, std::size_t reserve = 0) {
    std::lock_guard lock(mutex_);
    if (closed_ || !fits(cost, reserve)) return false;
    take(std::move(value), cost);
    return true;
  }

  /// Waits for an item; nothing once the queue is closed and drained.
  std::optional<T> pop() {
    std::unique_lock lock(mutex_);
    available_.wait(lock, [&] { return closed_ || !items_.empty(); });
    return give();
  }

  /// The same, but nothing also when none came within `wait`.
  std::optional<T> pop_within(std::chrono::nanoseconds wait) {
    std::unique_lock lock(mutex_);
    available_.wait_for(lock, wait, [&] { return closed_ || !items_.empty(); });
    return give();
  }

  /// Producers are refused from now on; consumers drain what is left.
  void close() {
    std::lock_guard lock(mutex_);
    closed_ = true;
    room_.notify_all();
    available_.notify_all();
  }

  /// Closed, and nothing left.
  bool drained() const {
    std::lock_guard lock(mutex_);
    return closed_ && items_.empty();
  }
  std::size_t size() const {
    std::lock_guard lock(mutex_);
    return items_.size();
  }
  std::size_t cost() const {
    std::lock_guard lock(mutex_);
    return cost_;
  }
  std::size_t peak_cost() const {
    std::lock_guard lock(mutex_);
    return peak_cost_;
  }

 private:
  bool fits(std::size_t cost, std::size_t reserve) const {
    return items_.empty() || cost_ + cost <= capacity_ + reserve;
  }
  void take(T value, std::size_t cost) {
    items_.emplace_back(std::move(value), cost);
    cost_ += cost;
    peak_cost_ = std::max(peak_cost_, cost_);
    available_.notify_one();
  }
  std::optional<T> give() {
    if (items_.empty()) return std::nullopt;
    std::optional<T> value(std::move(items_.front().first));
    cost_ -= items_.front().second;
    items_.pop_front();
    room_.notify_all();  // what has room now is not always the one that waited longest
    return value;
  }

  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable room_, available_;
  std::deque<std::pair<T, std::size_t>> items_;
  std::size_t cost_ = 0, peak_cost_ = 0;
  bool closed_ = false;
};

}  // namespace gnathion
