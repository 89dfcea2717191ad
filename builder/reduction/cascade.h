// The reduction of all resolutions in one pass over the points in Morton order.
#pragma once

#include <tbb/spin_mutex.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
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

/// Keeps members that are done, so that the next ones use the memory of their vectors. Thread-safe.
class MemberPool {
 public:
  using Handle = std::unique_ptr<Member>;

  /// Appends members without material and splats until there are `count`.
  void acquire(std::size_t count, std::vector<Handle>& members);

  /// Releases all of these. Requires that they are cleared.
  void release(std::vector<Handle>& members);

 private:
  tbb::spin_mutex mutex_;
  std::vector<Handle> free_;
};

/// Adds each member's splat at its next level, made from its moments.
void add_splats(std::span<const MemberPool::Handle> members, std::span<const format::Attribute> attributes);

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

  /// `pool` gets the members that are done. Pool and attributes must outlive this.
  Cascade(const Cube& cube, Reduction method, std::uint32_t leaf_points, std::span<const format::Attribute> attributes,
          MemberPool& pool, Sink sink, CascadePart part = {})
      : cube_(cube),
        method_(method),
        leaf_points_(leaf_points),
        node_points_(most_in_reduction_node(method, leaf_points)),
        attributes_(attributes),
        pool_(pool),
        sink_(std::move(sink)),
        part_(part),
        levels_(max_levels) {}

  /// Adds the next member of the first level, which has its splats.
  void push(MemberPool::Handle member) { push(part_.first, std::move(member)); }

  /// Reduces all nodes that are whole. It is faster to call this now and then than after each member.
  void advance() { close_nodes(false); }

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
    std::deque<MemberPool::Handle> entries;  // of nodes that are not whole yet
    std::uint64_t count = 0;                 // members, with those that are gone
    std::optional<MortonKey> before;         // last key of the nodes that are done
  };

  [[nodiscard]] bool reduces(const Level& level) const {
    return part_.end < max_levels || level.count > coarsest_target;
  }
  void push(std::size_t level, MemberPool::Handle member);
  void close_nodes(bool at_end);
  void close_nodes(std::size_t level, bool at_end);
  void close_node(std::size_t level, std::size_t size, int depth);
  void set_octants(const Level& level, std::size_t size, int depth) const;
  void prefetch_next(const Level& level, std::size_t size) const;
  void reduce_node(int depth);
  template <class Cluster>
  void merge_cluster(const Cluster& cluster, std::size_t kept);

  Cube cube_;
  Reduction method_;
  std::uint32_t leaf_points_;
  std::uint64_t node_points_;
  std::span<const format::Attribute> attributes_;
  MemberPool& pool_;
  Sink sink_;
  CascadePart part_;
  std::vector<Level> levels_;  // level 0 is not used

  // Scratch for the reduction node that is being closed: members, their keys, positions and owners, and the clusters.
  std::vector<MemberPool::Handle> node_members_;
  std::vector<MortonKey> node_keys_;
  std::vector<dvec3> node_positions_;
  std::vector<std::uint32_t> node_owners_;
  Clusters clusters_;

  // Scratch for the cluster that is being merged: the planes of its members, and their shifts from the point that
  // stays.
  std::vector<BoundaryPlane> planes_;
  std::vector<dvec3> shifts_;

  // Scratch for the level whose nodes are being closed. Merged members go on to the next level, done ones end here.
  std::vector<MemberPool::Handle> merged_;
  std::vector<MemberPool::Handle> done_;
};

}  // namespace splatvol
