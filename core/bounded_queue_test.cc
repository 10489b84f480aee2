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

TEST(BoundedQueue, CostsBoundItAndTheReserveIsForThoseThatMay) {
  BoundedQueue<int> queue(100);
  int a = 1, b = 2, c = 3, d = 4;
  EXPECT_TRUE(queue.try_push(a, 80));
  EXPECT_FALSE(queue.try_push(b, 30));
  EXPECT_TRUE(queue.try_push(b, 30, 10));
  EXPECT_FALSE(queue.try_push(c, 1, 10));
  EXPECT_EQ(queue.cost(), 110u);
  EXPECT_EQ(queue.pop(), 1);
  EXPECT_TRUE(queue.try_push(c, 70));
  EXPECT_EQ(queue.pop(), 2);
  EXPECT_EQ(queue.pop(), 3);
  EXPECT_EQ(queue.cost(), 0u);
  EXPECT_TRUE(queue.try_push(d, 1000));  // larger than the capacity, but alone
  EXPECT_EQ(queue.peak_cost(), 1000u);
}

TEST(BoundedQueue, WaitingForAnItemEnds) {
  BoundedQueue<int> queue(1);
  EXPECT_FALSE(queue.pop_within(std::chrono::milliseconds(1)).has_value());
  EXPECT_FALSE(queue.drained());
  EXPECT_TRUE(queue.push(5));
  queue.close();
  EXPECT_FALSE(queue.drained());
  EXPECT_EQ(queue.pop_within(std::chrono::seconds(60)), 5);
  EXPECT_TRUE(queue.drained());
}

TEST(BoundedQueue, ItemsOfDifferentCostAllGetIn) {
  BoundedQueue<int> queue(10);
  int one = 1;
  ASSERT_TRUE(queue.try_push(one, 10));
  std::thread large([&] { EXPECT_TRUE(queue.push(2, 10)); });
  std::thread small([&] { EXPECT_TRUE(queue.push(3, 1)); });
  int sum = 0;
  for (int i = 0; i < 3; ++i) sum += *queue.pop();
  EXPECT_EQ(sum, 6);
  large.join();
  small.join();
}

}  // namespace
}  // namespace gnathion
