// The points of a reduction node that stay for the next coarser resolution, and the points that go with each of them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/index_lists.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// How coarser resolutions are chosen.
enum class Reduction {
  octree,  // one point of each leaf of the octree: Meredith and Ma (2001), section 2.2
  mis,     // of each reduction node a maximal independent set of its Delaunay triangulation's vertices; section 2.1
  kdtree,  // one point of each bucket of a k-d tree over each reduction node
};

/// As in options and metadata: "octree", "mis", "kdtree".
[[nodiscard]] const char* reduction_name(Reduction method);

/// The reverse of reduction_name.
[[nodiscard]] Result<Reduction> parse_reduction(const std::string& name);

/// Most points in a reduction node: an octree leaf that no cluster leaves. In larger nodes fewer clusters are cut short
/// at a border, but the smallest nodes that can be drawn on their own are larger, too. Chosen by the error of pictures
/// with equally many splats (docs/accuracy.md).
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

/// Finds for each point of a reduction node the point that it goes with: itself if it stays. Points of one key go
/// together.
///
/// mis: vertices of the Delaunay triangulation stay in ascending order of their number of edges (ties: the earlier),
/// unless an edge joins them to one that stays already. Any other point goes with its nearest neighbour that stays.
/// Neighbours are joined by an edge.
///
/// kdtree: points are halved across the longest axis of the box round them until each bucket has at most `leaf_points`
/// distinct keys. The point of a bucket nearest to the centre of its box stays.
///
/// Requires a method other than octree, ascending keys, and spans of one length. Thread-safe.
void find_clusters(Reduction method, std::uint32_t leaf_points, std::span<const MortonKey> keys,
                   std::span<const dvec3> positions, std::span<std::uint32_t> owners);

/// The points of each cluster.
class Clusters {
 public:
  /// `owners`: of each point the one that it goes with.
  void assign(std::span<const std::uint32_t> owners) {
    members_.assign(owners.size(), [&](const auto& add) {
      for (std::uint32_t i = 0; i < owners.size(); ++i) add(owners[i], i);
    });
  }

  /// The points that go with this one, itself among them, in ascending order; none if it does not stay.
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t point) const { return members_[point]; }

 private:
  IndexLists members_;  // [point]
};

}  // namespace splatvol
