#include "builder/distributed/fair_shares.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

namespace splatvol {
namespace {

using namespace ::testing;

using Sizes = std::vector<std::uint64_t>;

TEST(FairShares, DealTheLargestFirst) {
  EXPECT_THAT(deal_largest_first(Sizes{1, 9, 4, 5, 3}, 2), ElementsAre(ElementsAre(1, 4), ElementsAre(0, 2, 3)));
}

TEST(FairShares, GoInTurnsWhereSizesAreEqualOrUnknown) {
  for (const std::uint64_t size : {0, 7})
    EXPECT_THAT(deal_largest_first(Sizes(5, size), 3),
                ElementsAre(ElementsAre(0, 3), ElementsAre(1, 4), ElementsAre(2)));
}

TEST(FairShares, MayBeEmpty) {
  EXPECT_THAT(deal_largest_first(Sizes{}, 2), ElementsAre(IsEmpty(), IsEmpty()));
  EXPECT_THAT(deal_largest_first(Sizes{3}, 2), ElementsAre(ElementsAre(0), IsEmpty()));
}

TEST(FairShares, HoldEachPartOnceAndDifferByOneAtMost) {
  std::mt19937_64 random(5);
  for (const std::size_t shares : {1, 2, 5, 16}) {
    Sizes sizes(300);
    std::lognormal_distribution<double> size(10, 3);
    for (std::uint64_t& s : sizes) s = static_cast<std::uint64_t>(size(random));
    Sizes all, sums;
    std::uint64_t last_part = 0;
    for (const Sizes& share : deal_largest_first(sizes, shares)) {
      EXPECT_TRUE(std::ranges::is_sorted(share));
      all.insert(all.end(), share.begin(), share.end());
      std::uint64_t sum = 0, least = ~std::uint64_t{0};
      for (const std::uint64_t part : share) sum += sizes[part], least = std::min(least, sizes[part]);
      if (share.size() > 1) last_part = std::max(last_part, least);
      if (share.size() > 1) sums.push_back(sum);
    }
    EXPECT_LE(std::ranges::max(sums) - std::ranges::min(sums), last_part);
    std::ranges::sort(all);
    Sizes every(sizes.size());
    std::iota(every.begin(), every.end(), 0);
    EXPECT_EQ(all, every);
  }
}

}  // namespace
}  // namespace splatvol
