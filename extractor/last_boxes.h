// Boxes in an order, and the last of them that holds a position.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Finds the last box that holds a position. Fast where boxes that follow each other are near each other.
class LastBoxes {
 public:
  explicit LastBoxes(std::span<const Box> boxes) : leaves_(std::bit_ceil(std::max<std::size_t>(boxes.size(), 1))) {
    nodes_.resize(2 * leaves_);
    std::ranges::copy(boxes, nodes_.begin() + static_cast<std::ptrdiff_t>(leaves_));
    for (std::size_t node = leaves_ - 1; node > 0; --node) {
      nodes_[node] = nodes_[2 * node];
      nodes_[node].include(nodes_[2 * node + 1]);
    }
  }

  /// Returns the number of the last box that holds the position, if it is above `number`, or else `number`.
  [[nodiscard]] std::size_t last_above(std::size_t number, const dvec3& position) const {
    return last_above(number, position, 1, leaves_);
  }

 private:
  // `node`: has `count` leaves.
  [[nodiscard]] std::size_t last_above(std::size_t number, const dvec3& position, std::size_t node,
                                       std::size_t count) const {
    const std::size_t first = node * count - leaves_;
    if (first + count - 1 <= number || squared_distance(nodes_[node], position) > 0) return number;
    if (count == 1) return first;
    const std::size_t last = last_above(number, position, 2 * node + 1, count / 2);
    return last > number ? last : last_above(number, position, 2 * node, count / 2);
  }

  std::size_t leaves_;
  std::vector<Box> nodes_;  // 1: the root; 2 n and 2 n + 1: the children of n
};

}  // namespace splatvol
