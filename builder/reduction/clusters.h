// Which points of a block stay for the next coarser resolution, and which go with them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/index_lists.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// How coarser resolutions are chosen: of each leaf of the octree one point, or some of each block.
enum class Reduction {
  octree,  // Meredith and Ma (2001), section 2.2
  mis,     // a maximal independent set of the Delaunay triangulation's vertices; section 2.1
  kdtree,  // halves of halves
};

/// As in options and metadata: "octree", "mis", "kdtree".
[[nodiscard]] const char* reduction_name(Reduction method);

/// Most points in a block: a leaf of an octree that no cluster leaves. The more, the fewer clusters are cut short at
/// its border, and the larger the nodes that can be drawn by themselves; chosen by the error of pictures with as many
/// splats (docs/accuracy.md).
[[nodiscard]] inline std::uint64_t most_in_reduction_node(Reduction method, std::uint64_t leaf_points) {
  switch (method) {
    case Reduction::mis:
      return std::max<std::uint64_t>(leaf_points, 256);
    case Reduction::kdtree:
      return std::max<std::uint64_t>(leaf_points, std::min<std::uint64_t>(8 * leaf_points, 512));
    default:
      return leaf_points;
  }
}

/// Visits the leaves of the octree below a cell at `depth` that holds keys [begin, end): cells with more than
/// `leaf_points` are split, down to the finest. Calls visit(begin, end, depth); `key(i)` gives the keys, ascending.
template <class Key, class Visit>
void for_each_leaf(const Key& key, std::size_t begin, std::size_t end, int depth, std::size_t leaf_points,
                   const Visit& visit) {
  while (begin < end) {
    const MortonKey& first = key(begin);
    const int leaf = leaf_depth(depth - 1, first, begin + leaf_points < end ? &key(begin + leaf_points) : nullptr);
    std::size_t leaf_end = begin + 1;
    while (leaf_end < end && common_depth(first, key(leaf_end)) >= leaf) ++leaf_end;
    visit(begin, leaf_end, leaf);
    if (leaf_end < end) depth = common_depth(first, key(leaf_end)) + 1;
    begin = leaf_end;
  }
}

/// Finds for each point of a block the one that it goes with: itself where it stays. Points of one key go together.
/// mis: the Delaunay triangulation's vertices with the fewest edges stay first, and of the others those that no edge
/// joins to one that stays (ties: the earlier); what does not stay goes with the nearest that an edge joins it to.
/// kdtree: points are halved across the longest axis of the box round them until `leaf_points` or fewer places are
/// left, of which the one nearest to that box's centre stays. Requires another method than octree, ascending keys, and
/// spans of one length. Thread-safe.
void find_clusters(Reduction method, std::uint32_t leaf_points, std::span<const MortonKey> keys,
                   std::span<const dvec3> positions, std::span<std::uint32_t> owners);

/// The clusters by the points that stay.
class Clusters {
 public:
  /// `owners`: of points, each less than their number.
  void assign(std::span<const std::uint32_t> owners) {
    members_.assign(owners.size(), [&](const auto& add) {
      for (std::uint32_t i = 0; i < owners.size(); ++i) add(owners[i], i);
    });
  }

  /// The points that go with this one, itself among them, in ascending order; none where it does not stay.
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t point) const { return members_[point]; }

 private:
  IndexLists members_;  // [point]
};

}  // namespace splatvol
