// Pulls a live source in a thread of its own, so that a test can act meanwhile and wait for what must come;
// and holds samples against one another, bit for bit.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <cstring>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "acquisition/device.h"

namespace gnathion {

class Pull {
 public:
  explicit Pull(Device& device) : device_(device), thread_([this] { run(); }) {}
  ~Pull() { stop(); }

  using Samples = std::vector<Sample>;
  /// False when `what` has not come true after `seconds`.
  bool wait(const std::function<bool(const Samples&)>& what, double seconds = 30) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return what(samples_); });
  }
  /// Waits for `n` more of T that `is` accepts, counted from now.
  template <class T>
  bool wait_more(std::size_t n, const std::function<bool(const T&)>& is, double seconds = 30) {
    std::size_t from = 0;
    {
      const std::lock_guard lock(mutex_);
      from = samples_.size();
    }
    return wait([&](const Samples& s) { return count<T>(s, is, from) >= n; }, seconds);
  }
  template <class T>
  static std::size_t count(const Samples& samples, const std::function<bool(const T&)>& is,
                           std::size_t from = 0) {
    std::size_t n = 0;
    for (std::size_t i = from; i < samples.size(); ++i)
      if (const T* t = std::get_if<T>(&samples[i]); t && is(*t)) ++n;
    return n;
  }
  template <class T>
  static std::vector<T> all(const Samples& samples) {
    std::vector<T> found;
    for (const Sample& s : samples)
      if (const T* t = std::get_if<T>(&s)) found.push_back(*t);
    return found;
  }
  /// Stops the device and returns everything it delivered.
  Samples stop() {
    device_.stop();
    if (thread_.joinable()) thread_.join();
    return samples_;
  }
  std::string error() {
    const std::lock_guard lock(mutex_);
    return error_;
  }

 private:
  void run() {
    for (;;) {
      auto next = device_.next();
      const std::lock_guard lock(mutex_);
      changed_.notify_all();
      if (!next) {
        error_ = next.error().line();
        return;
      }
      if (!*next) return;
      samples_.push_back(std::move(**next));
    }
  }

  Device& device_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Samples samples_;
  std::string error_;
  std::thread thread_;
};

/// A source over samples in memory.
class VectorSource : public Source {
 public:
  explicit VectorSource(std::vector<Sample> samples) : samples_(std::move(samples)) {}
  Result<std::optional<Sample>> next() override {
    if (at_ == samples_.size()) return std::nullopt;
    return samples_[at_++];
  }

 private:
  std::vector<Sample> samples_;
  std::size_t at_ = 0;
};

inline bool same_header(const SampleHeader& a, const SampleHeader& b) {
  return a.stream == b.stream && a.sequence == b.sequence && a.capture == b.capture &&
         a.arrival == b.arrival && a.device == b.device;
}
inline bool same_bits(const Rigid3& a, const Rigid3& b) {
  return std::memcmp(a.rotation.data(), b.rotation.data(), sizeof(double) * 9) == 0 &&
         std::memcmp(a.translation_mm.data(), b.translation_mm.data(), sizeof(double) * 3) == 0;
}
/// Every field, bit for bit; for the kinds that USB and HID instruments deliver.
inline bool same_sample(const Sample& a, const Sample& b) {
  if (a.index() != b.index() || !same_header(header_of(a), header_of(b))) return false;
  if (const auto* p = std::get_if<PoseSample>(&a)) {
    const auto& q = std::get<PoseSample>(b);
    return p->reference == q.reference && p->body == q.body && p->valid == q.valid && p->reason == q.reason &&
           same_bits(p->reference_from_body, q.reference_from_body);
  }
  if (const auto* e = std::get_if<EventSample>(&a)) {
    const auto& f = std::get<EventSample>(b);
    return e->kind == f.kind && e->pressed == f.pressed && e->text == f.text;
  }
  if (const auto* l = std::get_if<LedgerSample>(&a)) {
    const auto& m = std::get<LedgerSample>(b);
    return l->fate == m.fate && l->count == m.count && l->reason == m.reason;
  }
  if (const auto* t = std::get_if<TransferSample>(&a)) {
    const auto& u = std::get<TransferSample>(b);
    return t->endpoint == u.endpoint && t->status == u.status && t->data == u.data;
  }
  return false;
}
inline void expect_same_samples(const std::vector<Sample>& a, const std::vector<Sample>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_TRUE(same_sample(a[i], b[i])) << "sample " << i;
}

}  // namespace gnathion
