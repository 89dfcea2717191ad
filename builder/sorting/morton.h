// Morton keys with 42 bits for each axis (spec/svol-1.md, section 7): enough for twelve decades of spacing at once.
#pragma once

#ifdef __BMI2__
#include <immintrin.h>
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <compare>
#include <cstdint>
#include <type_traits>

#include "base/math.h"

namespace splatvol {

/// The path from the root to a finest node: one octant for each depth, from the highest bits down. Uses 126 bits.
struct MortonKey {
  std::uint64_t high = 0;  // octants at depths 0 to 20, 63 bits
  std::uint64_t low = 0;   // octants at depths 21 to 41

  auto operator<=>(const MortonKey&) const = default;
};

inline constexpr int max_morton_depth = 42;

/// Spreads the lowest 21 bits of x so that two zeros lie between neighbours.
[[nodiscard]] constexpr std::uint64_t spread_bits(std::uint64_t x) {
#ifdef __BMI2__
  if (!std::is_constant_evaluated()) return _pdep_u64(x, 0x1249249249249249u);
#endif
  x &= 0x1FFFFF;
  x = (x | x << 32) & 0x001F00000000FFFFu;
  x = (x | x << 16) & 0x001F0000FF0000FFu;
  x = (x | x << 8) & 0x100F00F00F00F00Fu;
  x = (x | x << 4) & 0x10C30C30C30C30C3u;
  x = (x | x << 2) & 0x1249249249249249u;
  return x;
}

/// The index of the finest node at `position`, on each axis. Requires a finite position inside the cube, borders
/// included.
[[nodiscard]] inline std::array<std::uint64_t, 3> finest_node(const dvec3& position, const Cube& cube) {
  constexpr double nodes = 1ull << max_morton_depth;
  std::array<std::uint64_t, 3> node;
  for (int axis = 0; axis < 3; ++axis)
    node[static_cast<std::size_t>(axis)] = static_cast<std::uint64_t>(
        std::clamp((position[axis] - cube.origin[axis]) / cube.edge * nodes, 0.0, nodes - 1));
  return node;
}

[[nodiscard]] inline MortonKey morton_key(const dvec3& position, const Cube& cube) {
  const auto [x, y, z] = finest_node(position, cube);
  const auto interleave = [](std::uint64_t a, std::uint64_t b, std::uint64_t c) {
    return spread_bits(a) | spread_bits(b) << 1 | spread_bits(c) << 2;
  };
  return {interleave(x >> 21, y >> 21, z >> 21), interleave(x, y, z)};
}

/// The depth of the smallest node that holds both.
[[nodiscard]] inline int common_depth(const MortonKey& a, const MortonKey& b) {
  if (a.high != b.high) return (std::countl_zero(a.high ^ b.high) - 1) / 3;
  if (a.low != b.low) return 21 + (std::countl_zero(a.low ^ b.low) - 1) / 3;
  return max_morton_depth;
}

/// The depth of the octree leaf whose first key is `first`. Nodes with more than N points are split. `shared_before` is
/// the depth of the smallest node that `first` shares with the key before it, -1 if there is none. `beyond` is the key
/// N keys after `first`, null if there is none.
[[nodiscard]] inline int leaf_depth(int shared_before, const MortonKey& first, const MortonKey* beyond) {
  const int shared = beyond ? std::max(shared_before, common_depth(first, *beyond)) : shared_before;
  return std::min(shared + 1, max_morton_depth);
}

/// The octant of the node at depth + 1 within the node at `depth`. Requires depth < max_morton_depth.
[[nodiscard]] inline unsigned octant_at(const MortonKey& key, int depth) {
  const std::uint64_t half = depth < 21 ? key.high : key.low;
  return static_cast<unsigned>(half >> (60 - 3 * (depth % 21)) & 7);
}

/// The edge of a node at `depth`.
[[nodiscard]] inline double node_edge(const Cube& cube, int depth) {
  return cube.edge * (1.0 / static_cast<double>(std::uint64_t{1} << depth));
}

/// The centre of the node at `depth` that holds `position`.
[[nodiscard]] inline dvec3 node_center(const dvec3& position, const Cube& cube, int depth) {
  const auto node = finest_node(position, cube);
  const double edge = node_edge(cube, depth);
  dvec3 center;
  for (int axis = 0; axis < 3; ++axis)
    center[axis] =
        cube.origin[axis] +
        (static_cast<double>(node[static_cast<std::size_t>(axis)] >> (max_morton_depth - depth)) + 0.5) * edge;
  return center;
}

}  // namespace splatvol
