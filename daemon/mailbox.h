// From one publisher to many subscribers of different speed: whoever is slow gets the newest, and learns how
// many it missed. Publishing never waits for a subscriber.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

namespace gnathion::daemon {

/// One subscriber's end. Holds the `depth` newest values (1: the newest alone).
template <class T>
class Mailbox {
 public:
  using Value = std::shared_ptr<const T>;
  struct Mail {
    Value value;
    std::uint64_t missed = 0;  ///< between the one taken before and this one
  };
  /// `wake` is called, from the publisher's thread, after a value has come; it must return at once.
  explicit Mailbox(std::size_t depth, std::function<void()> wake = {})
      : depth_(depth), wake_(std::move(wake)) {}

  void put(Value value) {
    {
      std::lock_guard lock(mutex_);
      if (waiting_.size() >= depth_) {
        waiting_.pop_front();
        ++missed_;
      }
      waiting_.push_back(std::move(value));
    }
    arrived_.notify_one();
    if (wake_) wake_();
  }
  /// Nothing when none came in time, or when the mailbox is closed.
  std::optional<Mail> take_within(std::chrono::nanoseconds wait) {
    std::unique_lock lock(mutex_);
    arrived_.wait_for(lock, wait, [&] { return closed_ || !waiting_.empty(); });
    if (waiting_.empty()) return std::nullopt;
    Mail mail{std::move(waiting_.front()), std::exchange(missed_, 0)};
    waiting_.pop_front();
    return mail;
  }
  void close() {
    std::lock_guard lock(mutex_);
    closed_ = true;
    arrived_.notify_all();
  }
  bool closed() const {
    std::lock_guard lock(mutex_);
    return closed_;
  }

 private:
  const std::size_t depth_;
  const std::function<void()> wake_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Value> waiting_;
  std::uint64_t missed_ = 0;
  bool closed_ = false;
};

/// Thread-safe. A subscriber leaves by dropping its mailbox.
template <class T>
class Hub {
 public:
  std::shared_ptr<Mailbox<T>> subscribe(std::size_t depth, std::function<void()> wake = {}) {
    auto box = std::make_shared<Mailbox<T>>(depth, std::move(wake));
    std::lock_guard lock(mutex_);
    if (closed_) box->close();
    if (last_) box->put(last_);
    boxes_.push_back(box);
    return box;
  }
  /// `keep`: who subscribes later gets this value first.
  void publish(typename Mailbox<T>::Value value, bool keep = false) {
    std::lock_guard lock(mutex_);
    if (keep) last_ = value;
    for (std::size_t i = 0; i < boxes_.size();) {
      if (const auto box = boxes_[i].lock()) {
        box->put(value);
        ++i;
      } else {
        boxes_[i] = std::move(boxes_.back());
        boxes_.pop_back();
      }
    }
  }
  bool has_subscribers() const {
    std::lock_guard lock(mutex_);
    for (const auto& box : boxes_)
      if (!box.expired()) return true;
    return false;
  }
  /// Every subscriber's wait ends, now and from now on.
  void close() {
    std::lock_guard lock(mutex_);
    closed_ = true;
    for (const auto& weak : boxes_)
      if (const auto box = weak.lock()) box->close();
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::weak_ptr<Mailbox<T>>> boxes_;
  typename Mailbox<T>::Value last_;
  bool closed_ = false;
};

}  // namespace gnathion::daemon
