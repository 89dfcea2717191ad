// The resolutions of a point set, by their definition, all in memory: an oracle for the cascade.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/morton.h"

namespace splatvol::test {

/// A resolution: some of the points, in Morton order, and the leaves of the octree over them.
struct Resolution {
  std::vector<std::uint64_t> members;  // indices of points
  std::vector<std::uint8_t> depths;    // [member]: of its leaf
  std::vector<std::uint8_t> counts;    // [member]: members in that leaf, at most 255
  std::vector<std::uint64_t> begins;   // [leaf]: its first member; last, the number of members

  [[nodiscard]] std::size_t size() const { return members.size(); }
};

/// Visits the octree over keys [begin, end) in depth-first order. Nodes with more than `leaf_points` of them are split,
/// down to the finest.
using NodeVisitor = std::function<void(std::size_t begin, std::size_t end, int depth, bool leaf)>;
void visit_octree(std::span<const MortonKey> keys, std::uint64_t leaf_points, const NodeVisitor& visit);

/// Returns the resolutions from the coarsest (index 0) to all points. A resolution has one point of each leaf of the
/// next finer one: the point nearest to the leaf's centre (of equally near points, the first in Morton order). Ends
/// when at most 512 points are left, or at 64 resolutions. Member k of a resolution is in leaf k of the next finer one.
/// Requires keys in ascending order, and spans of one length, not empty.
[[nodiscard]] std::vector<Resolution> reduce_by_octree(std::span<const MortonKey> keys,
                                                       std::span<const dvec3> positions, const Cube& cube,
                                                       std::uint32_t leaf_points);

/// Returns the segment of each point: the coarsest resolution that has it.
[[nodiscard]] std::vector<std::uint8_t> find_segments(std::span<const Resolution> resolutions);

/// Returns the points in file order: by segment, then in Morton order.
[[nodiscard]] std::vector<std::uint64_t> file_order(std::span<const Resolution> resolutions);

}  // namespace splatvol::test
