// The reduction of all resolutions in one pass over the points in Morton order.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/output/member.h"
#include "builder/reduction/clusters.h"
#include "builder/sorting/octree_nodes.h"
#include "format/volume_info.h"

namespace splatvol {

/// A resolution with so few points is not reduced.
inline constexpr std::uint64_t coarsest_target = 512;

/// Returns the point of a leaf that goes on to the next coarser level: the one nearest to the leaf's centre (ties: the
/// earlier). `position(i)` gives the positions of the leaf's `count` points.
template <class Position>
std::size_t nearest_to_center(const Cube& cube, int depth, std::size_t count, const Position& position) {
  const dvec3 center = node_center(position(0), cube, depth);
  std::size_t nearest = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < count; ++i) {
    const dvec3 offset = (position(i) - center) / cube.edge;
    const double distance = glm::dot(offset, offset);
    if (distance < least) nearest = i, least = distance;
  }
  return nearest;
}

/// The part of a reduction that a Cascade does.
struct CascadePart {
  KeyBorders borders;            // nodes across these have more members than a reduction node, at all levels here
  std::size_t first = 1;         // level of the members that are pushed
  std::size_t end = max_levels;  // members of this level go to Sink::beyond. If it is not max_levels, each level
                                 // before it has more than coarsest_target members in all parts together
};

/// Reduces all levels but the finest. A level holds only members whose reduction node is not whole yet.
class Cascade {
 public:
  /// Gets the splats and points.
  struct Sink {
    /// Gets the member whose splat is the next of a level, in Morton order; the splat has its leaf's depth and count.
    /// `node_depth`: depth of its reduction node.
    std::function<void(std::size_t level, const Member& member, int node_depth)> splat;
    /// Gets the next point of a level, in Morton order, that no coarser level has.
    std::function<void(std::size_t level, const Member& member)> point;
    /// Gets the next member of level CascadePart::end, in Morton order.
    std::function<void(const Member& member)> beyond = {};
  };

  /// Attributes must outlive this.
  Cascade(const Cube& cube, Reduction method, std::uint32_t leaf_points, std::span<const format::Attribute> attributes,
          Sink sink, CascadePart part = {});

  /// Adds a copy of the next member of the first level, which has its splats. Reduces nodes that are whole now and
  /// then.
  void push(const Member& member);

  /// Adds the material of another member to the last one that was pushed. Both have one Morton key, and count as being
  /// at one position.
  void add_to_last(const Member& other);

  /// Reduces all that is left. Called after the last member.
  void finish() { close_nodes(true); }

  /// Number of the first index leaf that can still get a splat.
  [[nodiscard]] std::uint64_t first_open_leaf() const;

  /// Members of each level from the first on.
  [[nodiscard]] std::vector<std::uint64_t> counts() const;

 private:
  struct Level {
    Members members;                  // of nodes that are not whole yet
    std::uint64_t count = 0;          // members, with those that are gone
    std::optional<MortonKey> before;  // last key of the nodes that are done
  };
  // Members [begin, end) of a level.
  struct Node {
    std::size_t level, begin, end;
    int depth;
  };

  [[nodiscard]] bool reduces(std::size_t level) const {
    return level + 1 < max_levels && (part_.end < max_levels || levels_[level].count > coarsest_target);
  }
  void close_nodes(bool at_end);
  void close_nodes(std::size_t level, bool at_end);
  void close_node(const Node& node);
  void set_octants(const Node& node);
  void reduce_node(const Node& node);
  template <class Cluster>
  void merge_cluster(const Node& node, const Cluster& cluster, std::size_t kept);

  Cube cube_;
  Reduction method_;
  std::uint32_t leaf_points_;
  std::uint64_t node_points_;
  std::span<const format::Attribute> attributes_;
  Sink sink_;
  CascadePart part_;
  std::vector<Level> levels_;  // level 0 is not used, and one is too many

  // Scratch for the reduction node that is being closed: keys and positions of its members, the member that each goes
  // with, and the clusters.
  std::vector<MortonKey> node_keys_;
  std::vector<dvec3> node_positions_;
  std::vector<std::uint32_t> node_owners_;
  Clusters clusters_;

  // Scratch for the cluster that is being merged: the planes of its members, and their shifts from the point that
  // stays.
  std::vector<BoundaryPlane> planes_;
  std::vector<dvec3> shifts_;
};

}  // namespace splatvol
