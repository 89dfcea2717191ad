// Nodes and leaves of an octree over points whose Morton keys ascend.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <ranges>
#include <span>

#include "base/math.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Box of the node at `depth` that holds the finest node `key`.
[[nodiscard]] inline Box node_box(const MortonKey& key, const Cube& cube, int depth) {
  std::array<std::uint64_t, 3> index = {0, 0, 0};
  for (int d = 0; d < depth; ++d)
    for (std::size_t axis = 0; axis < 3; ++axis) index[axis] = index[axis] << 1 | (octant_at(key, d) >> axis & 1);
  const double edge = std::ldexp(cube.edge, -depth), half = std::ldexp(cube.edge, -depth - 1);
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    const double center = cube.origin[axis] + (static_cast<double>(index[static_cast<std::size_t>(axis)]) + 0.5) * edge;
    box.low[axis] = center - half;
    box.high[axis] = center + half;
  }
  return box;
}

/// Borders of a range of keys whose octree is cut by itself. Requires that every node across a border has too many
/// points for a leaf. Such a node is split, and the keys beyond the border change nothing.
struct KeyBorders {
  std::optional<MortonKey> before;  // the last key below the range; none if no points lie there
  std::optional<MortonKey> behind;  // the first key above the range; none if no points lie there

  /// Depth of the smallest node that holds both `first` and keys before the range: -1 if there are none.
  [[nodiscard]] int shared_before(const MortonKey& first) const { return before ? common_depth(*before, first) : -1; }

  /// The same for keys behind the range.
  [[nodiscard]] int shared_behind(const MortonKey& first) const { return behind ? common_depth(first, *behind) : -1; }
};

/// A leaf among the keys of an array.
struct KeyLeaf {
  std::size_t end;  // where the next leaf begins
  int depth;
};

/// Finds the leaf that begins with key `begin`, in the octree whose nodes of more than `most` keys are split, down to
/// the finest node. `key(i)` gives the keys, ascending, for i < `end`. Requires that no key of the leaf follows
/// behind `end`, or that there are more than `most` keys from `begin` on. `shared_before`: depth of the smallest node
/// that holds both key `begin` and the key before it; -1 if there is none before.
template <class Key>
[[nodiscard]] KeyLeaf leaf_at(const Key& key, std::size_t begin, std::size_t end, std::size_t most, int shared_before) {
  const MortonKey& first = key(begin);
  const int depth = leaf_depth(shared_before, first, end - begin > most ? &key(begin + most) : nullptr);
  const auto is_inside = [&](std::size_t i) { return common_depth(first, key(i)) >= depth; };
  // Most leaves are small. The end of a large one is found by bisection.
  const std::size_t near = std::min(end, begin + 16);
  std::size_t leaf_end = begin + 1;
  while (leaf_end < near && is_inside(leaf_end)) ++leaf_end;
  if (leaf_end == near) leaf_end = *std::ranges::partition_point(std::views::iota(near, end), is_inside);
  return {leaf_end, depth};
}

/// As leaf_at, for the keys of an array. A leaf of more than `most` keys ends after `most` of them: its keys are all
/// equal.
[[nodiscard]] inline KeyLeaf leaf_part_at(std::span<const MortonKey> keys, std::size_t begin, std::size_t most,
                                          int shared_before) {
  const auto key = [&](std::size_t i) -> const MortonKey& { return keys[i]; };
  const KeyLeaf leaf = leaf_at(key, begin, std::min(begin + most + 1, keys.size()), most, shared_before);
  return {std::min(leaf.end, begin + most), leaf.depth};
}

/// Visits the leaves of the octree below a node at `depth` that holds keys [begin, end): nodes with more than
/// `leaf_points` keys are split, down to the finest. Calls visit(begin, end, depth); `key(i)` gives the keys,
/// ascending.
template <class Key, class Visit>
void for_each_leaf(const Key& key, std::size_t begin, std::size_t end, int depth, std::size_t leaf_points,
                   const Visit& visit) {
  int shared_before = depth - 1;
  while (begin < end) {
    const KeyLeaf leaf = leaf_at(key, begin, end, leaf_points, shared_before);
    visit(begin, leaf.end, leaf.depth);
    if (leaf.end < end) shared_before = common_depth(key(begin), key(leaf.end));
    begin = leaf.end;
  }
}

}  // namespace splatvol
