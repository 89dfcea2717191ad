// How many points of a segment go into a group.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace splatvol {

/// The most points of a group, by segment. Segments are counted from the finest one, as in Member.
struct GroupSizes {
  /// Not empty; the last number holds for all coarser segments too. Each is 64 to 65536.
  std::vector<std::uint32_t> points = {1024, 512};

  [[nodiscard]] std::uint32_t of(std::size_t segment) const { return points[std::min(segment, points.size() - 1)]; }

  [[nodiscard]] std::uint32_t largest() const { return std::ranges::max(points); }

  /// Returns them as the file has them, the coarsest segment first.
  [[nodiscard]] std::vector<std::uint32_t> coarsest_first(std::size_t segments) const {
    std::vector<std::uint32_t> result(segments);
    for (std::size_t s = 0; s < segments; ++s) result[segments - 1 - s] = of(s);
    return result;
  }
};

}  // namespace splatvol
