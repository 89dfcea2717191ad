#include "renderer/sort.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace splatvol {
namespace {

using ::testing::ElementsAreArray;

/// Sorts like KeySorter, with the standard library.
std::vector<std::uint32_t> expected_order(const std::vector<std::uint32_t>& keys) {
  std::vector<std::uint32_t> order;
  for (std::uint32_t i = 0; i < keys.size(); ++i)
    if (keys[i] != hidden_key) order.push_back(i);
  std::ranges::stable_sort(order, {}, [&](std::uint32_t i) { return keys[i]; });
  return order;
}

TEST(KeySorter, AgreesWithStableSort) {
  std::mt19937 generator(7);
  KeySorter sorter;

  // Large and small arrays in turn: nothing may be left over from an earlier call. 300,000 keys are sorted in parallel.
  for (const std::size_t count : {300'000, 0, 1, 2, 2049, 300'001, 17}) {
    for (const std::uint32_t mask : {0xffffffffU, 0x7U, 0xff000000U, 0x003ff800U, 0U}) {
      std::vector<std::uint32_t> keys(count);
      for (std::uint32_t& key : keys) key = generator() % 5 == 0 ? hidden_key : generator() & mask;
      const auto order = sorter.sort(keys);
      EXPECT_TRUE(std::ranges::equal(order, expected_order(keys))) << count << " keys & " << mask;
    }
  }
}

TEST(KeySorter, LeavesHiddenOut) {
  KeySorter sorter;
  const std::vector<std::uint32_t> keys{hidden_key, 5, hidden_key - 1, 5, 0};
  const auto order = sorter.sort(keys);
  EXPECT_THAT(std::vector(order.begin(), order.end()), ElementsAreArray({4, 1, 3, 2}));
  EXPECT_TRUE(sorter.sort(std::vector<std::uint32_t>(100'000, hidden_key)).empty());
}

}  // namespace
}  // namespace splatvol
