#include "sampler/position_tree.h"

#include <algorithm>
#include <cmath>

#include "base/interruption.h"

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_positions = 8;

bool is_finite(const dvec3& position) {
  return std::isfinite(position.x) && std::isfinite(position.y) && std::isfinite(position.z);
}

}  // namespace

PositionTree::PositionTree(std::span<const dvec3> positions) : positions_(positions) {
  for (std::uint32_t i = 0; i < positions.size(); ++i)
    if (is_finite(positions[i])) order_.push_back(i);
  if (!order_.empty()) make_node(0, static_cast<std::uint32_t>(order_.size()));
}

void PositionTree::make_node(std::uint32_t begin, std::uint32_t end) {
  const auto number = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({{}, begin, end, 0});
  Box box;
  for (std::uint32_t i = begin; i < end; ++i) box.include(positions_[order_[i]]);
  nodes_[number].box = box;
  // The first chunk after an interruption ends the work: no need to divide on.
  if (end - begin > leaf_positions && box.low != box.high && !is_interrupted()) {
    const int axis = longest_axis(box.extent());
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::ranges::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, {},
                             [&](std::uint32_t i) { return positions_[i][axis]; });
    make_node(begin, middle);
    make_node(middle, end);
  }
  nodes_[number].next = static_cast<std::uint32_t>(nodes_.size());
}

}  // namespace splatvol
