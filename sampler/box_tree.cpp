#include "sampler/box_tree.h"

#include <algorithm>
#include <cmath>

#include "base/interruption.h"

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_items = 8;

bool is_finite(const dvec3& position) {
  return std::isfinite(position.x) && std::isfinite(position.y) && std::isfinite(position.z);
}
bool is_finite(const Box& box) { return is_finite(box.low) && is_finite(box.high); }

double middle_of(const dvec3& position, int axis) { return position[axis]; }
double middle_of(const Box& box, int axis) { return 0.5 * (box.low[axis] + box.high[axis]); }

}  // namespace

BoxTree::BoxTree(std::span<const dvec3> positions) { make(positions); }
BoxTree::BoxTree(std::span<const Box> boxes) { make(boxes); }

template <class Items>
void BoxTree::make(const Items& items) {
  order_.reserve(items.size());
  for (std::uint32_t i = 0; i < items.size(); ++i)
    if (is_finite(items[i])) order_.push_back(i);
  if (!order_.empty()) make_node(items, 0, static_cast<std::uint32_t>(order_.size()));
}

template <class Items>
void BoxTree::make_node(const Items& items, std::uint32_t begin, std::uint32_t end) {
  const auto number = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({{}, begin, end, 0});
  Box box;
  for (std::uint32_t i = begin; i < end; ++i) box.include(items[order_[i]]);
  nodes_[number].box = box;
  // The first chunk after an interruption ends the work: no need to divide on.
  if (end - begin > leaf_items && box.low != box.high && !is_interrupted()) {
    const int axis = longest_axis(box.extent());
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::ranges::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, {},
                             [&](std::uint32_t i) { return middle_of(items[i], axis); });
    make_node(items, begin, middle);
    make_node(items, middle, end);
  }
  nodes_[number].next = static_cast<std::uint32_t>(nodes_.size());
}

}  // namespace splatvol
