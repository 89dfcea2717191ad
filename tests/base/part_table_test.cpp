#include "base/part_table.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace splatvol {
namespace {

using Number = std::shared_ptr<const std::uint64_t>;

struct PartTableTest : testing::Test {
  PartTableTest() : budget(100), share(budget, 80), other(budget, 20), table(budget) {}

  Number put(std::uint64_t number, std::uint64_t bytes) {
    auto reservation = share.reserve(bytes);
    return reservation ? table.insert<std::uint64_t>({0, 0, number}, number, std::move(*reservation)) : nullptr;
  }
  Number find(std::uint64_t number) { return table.find<std::uint64_t>({0, 0, number}); }
  Result<Number> get(std::uint64_t number, std::uint64_t expected, std::uint64_t taken) {
    const auto read = [&]() -> Result<std::uint64_t> {
      ++reads;
      return number;
    };
    return table.get<std::uint64_t>({0, 0, number}, share, expected, read,
                                    [&](const std::uint64_t& /*part*/) { return taken; });
  }

  MemoryBudget budget;
  MemoryShare share, other;
  PartTable table;
  std::atomic<int> reads = 0;
};

TEST_F(PartTableTest, FindsWhatWasPutIn) {
  put(1, 10);
  EXPECT_EQ(*find(1), 1u);
  EXPECT_FALSE(find(2));
  EXPECT_FALSE(table.find<std::uint64_t>({0, 0, 1, 7}));
  EXPECT_FALSE(table.find<std::uint64_t>({0, 0, 1, -1, 7}));
  EXPECT_FALSE(table.find<std::uint64_t>({7, 0, 1}));
}

TEST_F(PartTableTest, DropsWhatWasUsedLongestAgo) {
  for (std::uint64_t i = 1; i <= 3; ++i) put(i, 30);
  EXPECT_TRUE(find(1));
  put(4, 30);
  EXPECT_TRUE(find(1));
  EXPECT_FALSE(find(2));
  EXPECT_TRUE(find(3));
  EXPECT_EQ(budget.used(), 90u);
}

TEST_F(PartTableTest, KeepsWhatSomebodyHolds) {
  auto held = put(1, 50);
  put(2, 30);
  put(3, 20);
  EXPECT_EQ(share.used(), 50u);
  EXPECT_FALSE(share.reserve(40));
  EXPECT_TRUE(table.holds({0, 0, 2})) << "an impossible wish costs nothing";
  EXPECT_TRUE(other.reserve(20));
  EXPECT_FALSE(table.holds({0, 0, 2}));
  EXPECT_TRUE(table.holds({0, 0, 3}));
  const auto again = find(1);
  EXPECT_EQ(share.used(), 50u) << "it counts once";
  held.reset();
  EXPECT_EQ(share.used(), 50u);
}

TEST_F(PartTableTest, APartThatItsShareHasNoRoomForIsNotFound) {
  put(1, 50);
  const auto work = share.reserve(40);
  EXPECT_FALSE(find(1));
  EXPECT_TRUE(table.holds({0, 0, 1}));
}

TEST_F(PartTableTest, ASecondInsertKeepsTheFirst) {
  const auto first = put(1, 10);
  EXPECT_EQ(put(1, 10), first);
  EXPECT_EQ(budget.used(), 10u);
}

TEST_F(PartTableTest, CountsAPartByWhatItTakes) {
  ASSERT_TRUE(get(1, 10, 30));
  EXPECT_EQ(budget.used(), 30u);
  ASSERT_TRUE(get(2, 50, 20));
  EXPECT_EQ(budget.used(), 50u);
  EXPECT_EQ(**get(3, 10, 81), 3u) << "there is no room for it";
  EXPECT_FALSE(table.holds({0, 0, 3}));
  EXPECT_EQ(share.used(), 0u);
  EXPECT_EQ(reads, 3);
}

TEST_F(PartTableTest, ReadsAPartOnceWhoeverAsksFirst) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (std::uint64_t i = 0; i < 1000; ++i) ASSERT_EQ(**get(i % 4, 20, 20), i % 4);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(reads, 4);
}

TEST_F(PartTableTest, WhatCannotBeReadIsTriedAgain) {
  const auto failing = [&]() -> Result<std::uint64_t> {
    ++reads;
    return fail(ErrorCode::io, "no");
  };
  const auto bytes_of = [](const std::uint64_t& /*part*/) { return std::uint64_t{1}; };
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(table.get<std::uint64_t>({0, 0, 1}, share, 1, failing, bytes_of));
  EXPECT_EQ(reads, 2);
  EXPECT_EQ(budget.used(), 0u);
}

TEST_F(PartTableTest, HoldsAgainstManyThreads) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (std::uint64_t i = 0; i < 20000; ++i) {
        const auto part = get((i * (t + 1)) % 13, 15, 15);
        ASSERT_TRUE(part) << "four parts fit";
        ASSERT_LE(budget.used(), 100u);
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(share.used(), 0u);
  EXPECT_LE(budget.peak(), 100u);
  table.clear(0);
  EXPECT_EQ(budget.used(), 0u);
}

TEST_F(PartTableTest, TheLastRoomOfAFileDropsItsParts) {
  MemoryShare other(budget, 0);
  std::optional<PartRoom> room = room_in(table, share);
  std::optional<PartRoom> copy = room->in(other);
  const PartKey key{room->file, 0, 1};
  room->insert(key, std::uint64_t{1}, *share.reserve(10));
  EXPECT_TRUE(copy->holds(key)) << "the file is the same";
  EXPECT_FALSE(copy->find<std::uint64_t>({copy->file, 0, 2}));
  EXPECT_NE(room_in(table, share).file, room->file);
  room.reset();
  EXPECT_TRUE(table.holds(key));
  copy.reset();
  EXPECT_FALSE(table.holds(key));
  EXPECT_EQ(budget.used(), 0u);
}

TEST(OwnRoom, LivesAsLongAsACopy) {
  std::optional<PartRoom> room = own_room(10);
  const PartRoom copy = *room;
  room.reset();
  const auto part = copy.insert({copy.file, 0, 1}, std::uint64_t{7}, *copy.share->reserve(10));
  EXPECT_EQ(*part, 7u);
  EXPECT_FALSE(copy.share->reserve(1));
}

}  // namespace
}  // namespace splatvol
