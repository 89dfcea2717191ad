#include "streamer/cache.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

using Kind = CacheKey::Kind;

CacheData numbers(float first) { return DecodedChunk(std::vector<float>{first}); }

Cache::Pointer put(Cache& cache, std::uint64_t number, std::uint64_t bytes) {
  auto reservation = cache.reserve(bytes);
  if (!reservation) return nullptr;
  return cache.insert({Kind::chunk, number, 0}, numbers(static_cast<float>(number)), std::move(*reservation));
}

TEST(Cache, FindsWhatWasPutIn) {
  MemoryBudget budget(100);
  Cache cache(budget);
  put(cache, 1, 10);
  EXPECT_EQ(std::get<std::vector<float>>(std::get<DecodedChunk>(*cache.find({Kind::chunk, 1, 0}))).front(), 1);
  EXPECT_FALSE(cache.find({Kind::chunk, 2, 0}));
  EXPECT_FALSE(cache.find({Kind::chunk, 1, 1}));
}

TEST(Cache, DropsWhatWasUsedLongestAgo) {
  MemoryBudget budget(100);
  Cache cache(budget);
  for (std::uint64_t i = 1; i <= 3; ++i) put(cache, i, 30);
  EXPECT_TRUE(cache.find({Kind::chunk, 1, 0}));
  put(cache, 4, 30);
  EXPECT_TRUE(cache.find({Kind::chunk, 1, 0}));
  EXPECT_FALSE(cache.find({Kind::chunk, 2, 0}));
  EXPECT_TRUE(cache.find({Kind::chunk, 3, 0}));
  EXPECT_EQ(budget.used(), 90u);
}

TEST(Cache, KeepsWhatSomebodyHolds) {
  MemoryBudget budget(100);
  Cache cache(budget);
  const auto held = put(cache, 1, 50);
  put(cache, 2, 50);
  EXPECT_FALSE(cache.reserve(60));
  EXPECT_TRUE(cache.find({Kind::chunk, 1, 0}));
  EXPECT_FALSE(cache.find({Kind::chunk, 2, 0}));
  EXPECT_TRUE(cache.reserve(50));
}

TEST(Cache, AnImpossibleWishCostsNothing) {
  MemoryBudget budget(100);
  Cache cache(budget);
  put(cache, 1, 50);
  EXPECT_FALSE(cache.reserve(101));
  EXPECT_TRUE(cache.find({Kind::chunk, 1, 0}));
}

TEST(Cache, ASecondInsertKeepsTheFirst) {
  MemoryBudget budget(100);
  Cache cache(budget);
  const auto first = put(cache, 1, 10);
  EXPECT_EQ(put(cache, 1, 10), first);
  EXPECT_EQ(budget.used(), 10u);
}

}  // namespace
}  // namespace splatvol
