#include "core/bounded_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <numeric>
#include <thread>
#include <vector>

namespace gnathion {
namespace {

TEST(BoundedQueue, EveryItemArrivesOnceAcrossThreads) {
  BoundedQueue<int> queue(7);
  constexpr int kProducers = 3, kEach = 5000;
  std::vector<std::thread> threads;
  std::atomic<long> sum{0}, count{0};
  for (int p = 0; p < kProducers; ++p)
    threads.emplace_back([&, p] {
      for (int i = 0; i < kEach; ++i) ASSERT_TRUE(queue.push(p * kEach + i));
    });
  std::vector<std::thread> consumers;
  for (int c = 0; c < 2; ++c)
    consumers.emplace_back([&] {
      while (auto v = queue.pop()) {
        sum += *v;
        ++count;
      }
    });
  for (auto& t : threads) t.join();
  queue.close();
  for (auto& t : consumers) t.join();
  const long n = kProducers * kEach;
  EXPECT_EQ(count, n);
  EXPECT_EQ(sum, n * (n - 1) / 2);
}

TEST(BoundedQueue, FullAndClosedAreToldAndTheValueStays) {
  BoundedQueue<std::vector<int>> queue(1);
  std::vector<int> a{1}, b{2, 3};
  EXPECT_TRUE(queue.try_push(a));
  EXPECT_FALSE(queue.try_push(b));
  EXPECT_EQ(b.size(), 2u);
  queue.close();
  EXPECT_FALSE(queue.push({4}));
  EXPECT_TRUE(queue.pop().has_value());
  EXPECT_FALSE(queue.pop().has_value());
}

}  // namespace
}  // namespace gnathion
