#include "builder/distributed/key_ranges.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace splatvol {
namespace {

constexpr MortonKey last_of_all = {(std::uint64_t{1} << 63) - 1, (std::uint64_t{1} << 63) - 1};

std::vector<MortonKey> random_keys(std::size_t count, double extent) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> coordinate(0, extent);
  const Cube cube{dvec3(0), 1.0};
  std::vector<MortonKey> keys;
  for (std::size_t i = 0; i < count; ++i)
    keys.push_back(morton_key({coordinate(random), coordinate(random), coordinate(random)}, cube));
  std::ranges::sort(keys);
  return keys;
}

std::size_t count_between(const std::vector<MortonKey>& keys, const MortonKey& first, const MortonKey& last) {
  return static_cast<std::size_t>(std::ranges::upper_bound(keys, last) - std::ranges::lower_bound(keys, first));
}

TEST(KeyRanges, FirstAndLastKeysShareANode) {
  const MortonKey key = random_keys(1, 1)[0];
  for (int depth = 0; depth <= max_morton_depth; ++depth) {
    const MortonKey first = first_key(key, depth), last = last_key(key, depth);
    EXPECT_LE(first, key);
    EXPECT_GE(last, key);
    EXPECT_EQ(common_depth(first, last), depth);
    if (depth > 0) {
      EXPECT_LT(common_depth(key_before(first), first), depth);
    }
    EXPECT_EQ(key_before(key_behind(key)), key);
  }
  EXPECT_EQ(first_key(key, 0), MortonKey());
  EXPECT_EQ(last_key(key, 0), last_of_all);
  EXPECT_GT(key_behind(last_of_all), last_of_all);
}

TEST(KeyRanges, AreEvenAndCutNoSmallNode) {
  constexpr std::size_t least = 200;
  for (const double extent : {1.0, 1e-3}) {
    const std::vector<MortonKey> keys = random_keys(100'000, extent);
    for (const std::size_t ranges : {2u, 3u, 8u, 64u}) {
      const RangeBegins begins = choose_ranges(keys, ranges, least);
      ASSERT_EQ(begins.size() + 1, ranges);
      EXPECT_TRUE(std::ranges::is_sorted(begins));
      std::vector<std::size_t> counts(ranges);
      for (const MortonKey& key : keys) ++counts[range_of(begins, key)];
      const double mean = 100'000.0 / static_cast<double>(ranges);
      EXPECT_THAT(counts, testing::Each(testing::Le(std::lround(1.3 * mean)))) << ranges;
      for (const MortonKey& begin : begins) {
        const int depth = common_depth(key_before(begin), begin);
        EXPECT_GE(count_between(keys, first_key(begin, depth), last_key(begin, depth)), least);
      }
    }
  }
}

TEST(KeyRanges, AreFewerWhereTheKeysDoNotAllowMore) {
  EXPECT_THAT(choose_ranges({}, 4, 10), testing::IsEmpty());
  const std::vector<MortonKey> equal(1000, random_keys(1, 1)[0]);
  const RangeBegins begins = choose_ranges(equal, 4, 10);
  std::set<std::size_t> used;
  for (const MortonKey& key : equal) used.insert(range_of(begins, key));
  EXPECT_EQ(used.size(), 1u);
  EXPECT_THAT(choose_ranges(random_keys(100, 1), 4, 101), testing::IsEmpty());
}

TEST(KeyRanges, HaveBordersOnlyBetweenEachOther) {
  const RangeBegins begins = choose_ranges(random_keys(10'000, 1), 3, 100);
  ASSERT_EQ(begins.size(), 2u);
  EXPECT_FALSE(borders_of(begins, 0).before);
  EXPECT_EQ(borders_of(begins, 0).behind, begins[0]);
  EXPECT_EQ(borders_of(begins, 1).before, key_before(begins[0]));
  EXPECT_FALSE(borders_of(begins, 2).behind);
}

TEST(PositionSamples, KeepOneShareOfAllPoints) {
  PositionSamples samples(1000);
  for (std::uint64_t i = 0; i < 100'000; ++i) samples.add(i, dvec3(0));
  EXPECT_LE(samples.samples().size(), 1000u);
  const double expected = 100'000 * PositionSamples::probability(samples.limit());
  EXPECT_GE(expected, 400);
  EXPECT_NEAR(static_cast<double>(samples.samples().size()), expected, 5 * std::sqrt(expected));
}

}  // namespace
}  // namespace splatvol
