// Coarser and coarser subsets of a point set by their definition, all in memory: an oracle for the cascade.
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
  std::vector<std::uint64_t> begins;   // [leaf]: its first member; and the number of members at the end

  [[nodiscard]] std::size_t size() const { return members.size(); }
};

/// Visits the octree over keys [begin, end) in depth-first order. Nodes with more than `leaf_points` of them are split,
/// down to the finest.
using NodeVisitor = std::function<void(std::size_t begin, std::size_t end, int depth, bool leaf)>;
void visit_octree(std::span<const MortonKey> keys, std::uint64_t leaf_points, const NodeVisitor& visit);

/// Resolutions from the coarsest (index 0) to all points. Of each leaf of one resolution the point nearest to the
/// leaf's centre goes on to the next coarser one (ties: the earlier in Morton order), until at most 512 points are left
/// or there are 64 resolutions. Requires keys in ascending order; both spans of one length, not empty. Leaf k of a
/// resolution keeps member k of the next coarser one.
[[nodiscard]] std::vector<Resolution> reduce_by_octree(std::span<const MortonKey> keys,
                                                       std::span<const dvec3> positions, const Cube& cube,
                                                       std::uint32_t leaf_points);

/// The coarsest resolution that each point belongs to: its segment.
[[nodiscard]] std::vector<std::uint8_t> find_segments(std::span<const Resolution> resolutions);

/// Points in file order: by segment, then along the Morton curve.
[[nodiscard]] std::vector<std::uint64_t> file_order(std::span<const Resolution> resolutions);

}  // namespace splatvol::test
