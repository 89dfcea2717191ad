// Coarser and coarser subsets of a point set: the direct octree of Meredith and Ma (2001), section 2.2.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/morton.h"

namespace splatvol {

/// A resolution: some of the points, each in a leaf of an octree over them with at most `leaf_points` points in a leaf
/// (more only where they share the finest cell). Arrays of equal length, in Morton order.
struct Resolution {
  std::vector<std::uint64_t> members;  // indices of points
  std::vector<std::uint8_t> depths;    // of the member's leaf
  std::vector<std::uint8_t> counts;    // members in that leaf, at most 255

  [[nodiscard]] std::size_t size() const { return members.size(); }
};

/// Leaves of the octree over `members`: fills depths and counts. Requires keys in ascending order, leaf_points >= 1.
void find_leaves(std::span<const MortonKey> keys, std::uint32_t leaf_points, Resolution& resolution);

/// Where in `resolution` each leaf's members begin, and their number at the end. Requires find_leaves' result.
[[nodiscard]] std::vector<std::uint64_t> leaf_begins(std::span<const MortonKey> keys, const Resolution& resolution);

/// Resolutions from the coarsest (index 0) to all points. Of each leaf of one resolution the point nearest to the
/// leaf's centre goes on to the next coarser one (ties: the earlier in Morton order), until one leaf is left, at most
/// 512 points are, or there are 64 resolutions. Requires keys in ascending order; both spans of one length, not empty.
/// Leaf k of a resolution keeps member k of the next coarser one.
[[nodiscard]] std::vector<Resolution> reduce_by_octree(std::span<const MortonKey> keys,
                                                       std::span<const dvec3> positions, const Cube& cube,
                                                       std::uint32_t leaf_points);

/// The coarsest resolution that each point belongs to: its segment.
[[nodiscard]] std::vector<std::uint8_t> find_segments(std::span<const Resolution> resolutions);

}  // namespace splatvol
