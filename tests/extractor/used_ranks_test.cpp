// Ranks that were added get numbers in their order.
#include "extractor/used_ranks.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace splatvol {
namespace {

TEST(UsedRanks, NumberAsASortedSet) {
  const std::uint64_t points = 5 * format::rank_page_points + 123;
  UsedRanks used(points);
  std::set<std::uint64_t> expected = {0, 63, 64, format::rank_page_points - 1, format::rank_page_points, points - 1};
  std::mt19937_64 random(3);
  for (int i = 0; i < 5000; ++i) {
    const std::uint64_t rank = random() % points;
    if (rank / format::rank_page_points != 3) expected.insert(rank);
  }
  for (const std::uint64_t rank : expected) {
    const std::array<std::uint64_t, 2> twice = {rank, rank};
    used.add(twice);
  }
  EXPECT_EQ(used.number(), expected.size());

  std::vector<std::uint64_t> ranks;
  for (std::size_t page = 0; page < used.page_count(); ++page)
    for (const std::uint64_t rank : used.ranks_of_page(page)) ranks.push_back(rank);
  EXPECT_EQ(ranks, std::vector<std::uint64_t>(expected.begin(), expected.end()));
  EXPECT_TRUE(used.ranks_of_page(3).empty());

  std::uint64_t number = 0;
  for (std::uint64_t rank = 0; rank < points; ++rank) {
    ASSERT_EQ(used.has(rank), expected.contains(rank)) << rank;
    if (used.has(rank)) {
      ASSERT_EQ(used.number_of(rank), number++) << rank;
    }
  }
  EXPECT_FALSE(used.has(points + format::rank_page_points));
}

// A page whose ranks are all there: counts up to the word before the last fit.
TEST(UsedRanks, AFullPage) {
  UsedRanks used(format::rank_page_points);
  std::vector<std::uint64_t> all(format::rank_page_points);
  for (std::uint64_t rank = 0; rank < all.size(); ++rank) all[rank] = rank;
  used.add(all);
  EXPECT_EQ(used.number(), all.size());
  for (const std::uint64_t rank : all) ASSERT_EQ(used.number_of(rank), rank);
  EXPECT_EQ(used.ranks_of_page(0), all);
}

}  // namespace
}  // namespace splatvol
