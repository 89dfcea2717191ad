#include "builder/distributed/fair_shares.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <queue>
#include <tuple>

namespace splatvol {

std::vector<std::vector<std::uint64_t>> deal_largest_first(std::span<const std::uint64_t> sizes, std::size_t shares) {
  std::vector<std::uint64_t> order(sizes.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, std::greater(), [&](std::uint64_t part) { return sizes[part]; });

  // Size, number of parts and number of a share. Sizes may be unknown, and 0: then the parts count.
  using Share = std::tuple<std::uint64_t, std::size_t, std::size_t>;
  std::priority_queue<Share, std::vector<Share>, std::greater<>> least;
  for (std::size_t s = 0; s < shares; ++s) least.emplace(0, 0, s);
  std::vector<std::vector<std::uint64_t>> dealt(shares);
  for (const std::uint64_t part : order) {
    const auto [size, count, share] = least.top();
    least.pop();
    dealt[share].push_back(part);
    least.emplace(size + sizes[part], count + 1, share);
  }
  for (std::vector<std::uint64_t>& parts : dealt) std::ranges::sort(parts);
  return dealt;
}

}  // namespace splatvol
