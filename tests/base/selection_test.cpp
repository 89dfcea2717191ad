#include "base/selection.h"

#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <vector>

namespace splatvol {
namespace {

std::vector<std::vector<int>> orders(int count) {
  std::mt19937 random(3);
  std::vector<std::vector<int>> all(6);
  for (int i = 0; i < count; ++i) {
    all[0].push_back(i);
    all[1].push_back(count - i);
    all[2].push_back(7);
    all[3].push_back(static_cast<int>(random() % 3));
    all[4].push_back(static_cast<int>(random()));
    all[5].push_back(std::min(i, count - i));
  }
  return all;
}

TEST(Selection, PutsEachItemWhereSortingWould) {
  for (int count = 1; count < 300; count += count / 16 + 1)
    for (const std::vector<int>& items : orders(count)) {
      std::vector<int> sorted = items;
      std::ranges::sort(sorted);
      for (std::size_t nth = 0; nth < items.size(); ++nth) {
        std::vector<int> selected = items;
        select_nth(std::span(selected), nth, std::less<>());
        const auto middle = selected.begin() + static_cast<std::ptrdiff_t>(nth);
        ASSERT_EQ(*middle, sorted[nth]) << count;
        EXPECT_LE(*std::max_element(selected.begin(), middle + 1), *middle);
        EXPECT_GE(*std::min_element(middle, selected.end()), *middle);
        std::ranges::sort(selected);
        EXPECT_EQ(selected, sorted);
      }
    }
}

}  // namespace
}  // namespace splatvol
