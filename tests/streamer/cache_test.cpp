#include "streamer/cache.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

using Kind = CacheKey::Kind;

CacheData numbers(float first) {
  return std::make_shared<const ValueRow>(ValueRow(std::vector<OctantValue>{{first, 0}}));
}

Cache::Pointer put(Cache& cache, std::uint64_t number, std::uint64_t bytes) {
  auto reservation = cache.reserve(bytes);
  if (!reservation) return nullptr;
  return cache.insert({Kind::values, number, 0}, numbers(static_cast<float>(number)), std::move(*reservation));
}

TEST(Cache, FindsWhatWasPutIn) {
  OwnParts parts(100);
  Cache cache(parts.room());
  put(cache, 1, 10);
  const auto row = std::get<std::shared_ptr<const ValueRow>>(*cache.find({Kind::values, 1, 0}));
  EXPECT_EQ(std::get<std::vector<OctantValue>>(row->records()).front().value, 1);
  EXPECT_FALSE(cache.find({Kind::values, 2, 0}));
  EXPECT_FALSE(cache.find({Kind::values, 1, 1}));
}

TEST(Cache, DropsWhatWasUsedLongestAgo) {
  OwnParts parts(100);
  Cache cache(parts.room());
  for (std::uint64_t i = 1; i <= 3; ++i) put(cache, i, 30);
  EXPECT_TRUE(cache.find({Kind::values, 1, 0}));
  put(cache, 4, 30);
  EXPECT_TRUE(cache.find({Kind::values, 1, 0}));
  EXPECT_FALSE(cache.find({Kind::values, 2, 0}));
  EXPECT_TRUE(cache.find({Kind::values, 3, 0}));
  EXPECT_EQ(parts.room().share->budget().used(), 90u);
}

TEST(Cache, KeepsWhatSomebodyHolds) {
  OwnParts parts(100);
  Cache cache(parts.room());
  const auto held = put(cache, 1, 50);
  put(cache, 2, 50);
  EXPECT_FALSE(cache.reserve(60));
  EXPECT_TRUE(cache.find({Kind::values, 1, 0}));
  EXPECT_TRUE(cache.find({Kind::values, 2, 0}));
  EXPECT_TRUE(cache.reserve(50));
  EXPECT_FALSE(cache.find({Kind::values, 2, 0}));
}

TEST(Cache, AnImpossibleWishCostsNothing) {
  OwnParts parts(100);
  Cache cache(parts.room());
  put(cache, 1, 50);
  EXPECT_FALSE(cache.reserve(101));
  EXPECT_TRUE(cache.find({Kind::values, 1, 0}));
}

TEST(Cache, AReservationGrowsAndIsGivenBackIfItCannot) {
  OwnParts parts(100);
  Cache cache(parts.room());
  put(cache, 1, 50);
  auto reservation = cache.reserve(20);
  ASSERT_TRUE(reservation);
  EXPECT_TRUE(cache.extend(*reservation, 10));
  EXPECT_EQ(reservation->bytes(), 20u);
  EXPECT_TRUE(cache.extend(*reservation, 80));
  EXPECT_EQ(parts.room().share->budget().used(), 80u) << "the part gave way";
  const auto held = put(cache, 2, 10);
  EXPECT_FALSE(cache.extend(*reservation, 91));
  EXPECT_EQ(parts.room().share->budget().used(), 10u);
}

TEST(Cache, ASecondInsertKeepsTheFirst) {
  OwnParts parts(100);
  Cache cache(parts.room());
  const auto first = put(cache, 1, 10);
  EXPECT_EQ(put(cache, 1, 10), first);
  EXPECT_EQ(parts.room().share->budget().used(), 10u);
}

// Another attribute of a file has the same shapes, and values of its own.
TEST(Cache, SharesShapesWithAnother) {
  OwnParts parts(100);
  PartRoom room = parts.room();
  Cache cache(room);
  room.file = room.table->add_file();
  Cache other(room, cache.shapes());
  for (const Kind kind : {Kind::shapes, Kind::values}) cache.insert({kind, 1}, numbers(1), *cache.reserve(10));
  EXPECT_TRUE(other.find({Kind::shapes, 1}));
  EXPECT_FALSE(other.find({Kind::values, 1}));
  cache.clear();
  EXPECT_FALSE(cache.find({Kind::shapes, 1}));
  EXPECT_FALSE(cache.find({Kind::values, 1}));
  EXPECT_TRUE(other.find({Kind::shapes, 1}));
}

}  // namespace
}  // namespace splatvol
