#include "streamer/budget.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>
#include <vector>

namespace splatvol {
namespace {

TEST(MemoryBudget, GrantsUpToItsCapacityAndNoByteMore) {
  MemoryBudget budget(100);
  auto a = budget.reserve(60);
  ASSERT_TRUE(a);
  EXPECT_FALSE(budget.reserve(41));
  EXPECT_FALSE(budget.reserve(std::numeric_limits<std::uint64_t>::max()));
  auto b = budget.reserve(40);
  ASSERT_TRUE(b);
  EXPECT_EQ(budget.used(), 100u);
  EXPECT_FALSE(budget.reserve(1));
  EXPECT_TRUE(budget.reserve(0));
}

TEST(MemoryBudget, ReservationsGiveTheirBytesBackOnce) {
  MemoryBudget budget(100);
  {
    auto a = budget.reserve(70);
    Reservation b = std::move(*a);
    a.reset();
    EXPECT_EQ(budget.used(), 70u);
    EXPECT_EQ(b.bytes(), 70u);
    Reservation c;
    c = std::move(b);
    EXPECT_EQ(budget.used(), 70u);
  }
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_EQ(budget.peak(), 70u);
}

TEST(MemoryBudget, HoldsAgainstManyThreads) {
  MemoryBudget budget(1000);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 20000; ++i) {
        const auto a = budget.reserve(300);
        const auto b = budget.reserve(200);
        ASSERT_LE(budget.used(), 1000u);
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_LE(budget.peak(), 1000u);
}

}  // namespace
}  // namespace splatvol
