#include "base/memory_budget.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>
#include <vector>

namespace splatvol {
namespace {

TEST(MemoryBudget, GrantsUpToItsCapacityAndNoByteMore) {
  MemoryBudget budget(100);
  MemoryShare all(budget, 100);
  const auto a = all.reserve(60);
  ASSERT_TRUE(a);
  EXPECT_FALSE(all.reserve(41));
  EXPECT_FALSE(all.reserve(std::numeric_limits<std::uint64_t>::max()));
  const auto b = all.reserve(40);
  ASSERT_TRUE(b);
  EXPECT_EQ(budget.used(), 100u);
  EXPECT_FALSE(all.reserve(1));
  EXPECT_TRUE(all.reserve(0));
}

TEST(MemoryBudget, ReservationsGiveTheirBytesBackOnce) {
  MemoryBudget budget(100);
  MemoryShare all(budget, 100);
  {
    auto a = all.reserve(70);
    Reservation b = std::move(*a);
    a.reset();
    EXPECT_EQ(budget.used(), 70u);
    EXPECT_EQ(b.bytes(), 70u);
    Reservation c;
    c = std::move(b);
    EXPECT_EQ(budget.used(), 70u);
    EXPECT_TRUE(c.resize(90));
    EXPECT_EQ(c.bytes(), 90u);
    EXPECT_FALSE(c.resize(101));
    EXPECT_EQ(budget.used(), 90u);
    EXPECT_TRUE(c.resize(30));
    EXPECT_EQ(budget.used(), 30u);
    EXPECT_EQ(all.used(), 30u);
  }
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_EQ(all.used(), 0u);
  EXPECT_EQ(budget.peak(), 90u);
}

TEST(MemoryBudget, ASharesBytesAreItsOwn) {
  MemoryBudget budget(100);
  MemoryShare a(budget, 60), b(budget, 40);
  const auto all_of_a = a.reserve(60);
  ASSERT_TRUE(all_of_a);
  EXPECT_FALSE(a.reserve(1)) << "the bytes of b are free, but not for a";
  EXPECT_TRUE(b.reserve(40));
}

TEST(MemoryBudget, SpareBytesLieInAnyShareUntilItsUserWantsThem) {
  MemoryBudget budget(100);
  MemoryShare a(budget, 60), b(budget, 40);
  std::vector<Reservation> spare;
  budget.set_yield([&] {
    if (spare.empty()) return false;
    spare.pop_back();
    return true;
  });
  for (int i = 0; i < 5; ++i) {
    auto part = a.reserve(20);
    ASSERT_TRUE(part);
    part->loosen();
    spare.push_back(std::move(*part));
  }
  EXPECT_EQ(budget.used(), 100u);
  EXPECT_EQ(a.used(), 0u);
  EXPECT_FALSE(b.reserve_free(1));
  const auto of_b = b.reserve(30);
  ASSERT_TRUE(of_b);
  EXPECT_EQ(spare.size(), 3u);
  EXPECT_FALSE(b.reserve(11));
  EXPECT_EQ(spare.size(), 3u) << "an impossible wish costs nothing";
  const auto of_a = a.reserve(50);
  ASSERT_TRUE(of_a);
  ASSERT_EQ(spare.size(), 1u);
  EXPECT_FALSE(spare[0].fasten()) << "a has no room for it";
  EXPECT_EQ(budget.used(), 100u);
}

TEST(MemoryBudget, HoldsAgainstManyThreads) {
  MemoryBudget budget(1000);
  MemoryShare all(budget, 1000);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 20000; ++i) {
        const auto a = all.reserve(300);
        const auto b = all.reserve(200);
        ASSERT_LE(budget.used(), 1000u);
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(budget.used(), 0u);
  EXPECT_LE(budget.peak(), 1000u);
}

}  // namespace
}  // namespace splatvol
