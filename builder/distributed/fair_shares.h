// Parts of an input, dealt to ranks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace splatvol {

/// Deals parts of these sizes: the largest first, each to the share that has the least. So the
/// largest share exceeds the smallest one by at most a part (R. L. Graham, Bounds on multiprocessing timing anomalies,
/// 1969). Returns the numbers of
/// each share's parts, ascending.
[[nodiscard]] std::vector<std::vector<std::uint64_t>> deal_largest_first(std::span<const std::uint64_t> sizes,
                                                                         std::size_t shares);

}  // namespace splatvol
