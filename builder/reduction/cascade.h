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
#include "builder/sorting/morton.h"

namespace splatvol {

/// No further reduction of so few points.
inline constexpr std::uint64_t coarsest_target = 512;

/// Members whose part is done, kept for the next ones: their vectors keep their memory. Thread-safe.
class MemberPool {
 public:
  using Handle = std::unique_ptr<Member>;

  /// Makes `members` so many, the new ones without material and splats.
  void take(std::size_t count, std::vector<Handle>& members);

  /// Takes them all, cleared ones.
  void give_back(std::vector<Handle>& members);

 private:
  tbb::spin_mutex mutex_;
  std::vector<Handle> free_;
};

/// Adds the splats of the members' next levels, made from their moments. `offsets`: of the attributes.
void add_splats(std::span<const MemberPool::Handle> members, std::span<const double> offsets);

/// What of a leaf goes on: the point nearest to the leaf's centre (ties: the earlier). `position(i)` gives the places
/// of `count` points.
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

/// All levels but the finest. A level holds only members whose block is not whole yet.
class Cascade {
 public:
  /// What becomes of splats and points.
  struct Sink {
    /// The next splat of a level, in Morton order, with its leaf's depth and count, and the depth of its block.
    std::function<void(std::size_t level, const Member& member, int node_depth)> splat;
    /// A point that no coarser level has; within a level's own in Morton order.
    std::function<void(std::size_t level, const Member& member)> point;
  };

  /// What is done goes to `pool`, which must outlive this.
  Cascade(const Cube& cube, Reduction method, std::uint32_t leaf_points, std::vector<double> offsets, MemberPool& pool,
          Sink sink)
      : cube_(cube),
        method_(method),
        leaf_points_(leaf_points),
        node_points_(most_in_reduction_node(method, leaf_points)),
        offsets_(std::move(offsets)),
        pool_(pool),
        sink_(std::move(sink)),
        levels_(max_levels) {}

  /// The next member of level 1, its splats made.
  void push(MemberPool::Handle member) { push(1, std::move(member)); }

  /// Reduces what can be. Once in a while is enough, and faster than after each member.
  void advance() { close_nodes(false); }

  /// Adds the material of another member to the last that was pushed; both are at the same place.
  void add_to_last(const Member& other);

  /// After the last member.
  void finish() { close_nodes(true); }

  /// Number of the first index leaf that can still get something.
  [[nodiscard]] std::uint64_t first_open_leaf() const;

  /// Members of each level from 1 on.
  [[nodiscard]] std::vector<std::uint64_t> counts() const;

 private:
  struct Level {
    std::deque<MemberPool::Handle> entries;  // of blocks that are not whole yet
    std::uint64_t count = 0;                 // members, those that are gone included
    std::optional<MortonKey> before;         // last key of the blocks that are done
    [[nodiscard]] bool reduces() const { return count > coarsest_target; }
  };

  void push(std::size_t level, MemberPool::Handle member);
  void close_nodes(bool at_end);
  void close_nodes(std::size_t level, bool at_end);
  void close_node(std::size_t level, std::size_t size, int depth);
  void prefetch_next(const Level& level, std::size_t size) const;
  void reduce_node(int depth);
  template <class Cluster>
  void merge_cluster(const Cluster& cluster, std::size_t kept);

  Cube cube_;
  Reduction method_;
  std::uint32_t leaf_points_;
  std::uint64_t node_points_;
  std::vector<double> offsets_;
  MemberPool& pool_;
  Sink sink_;
  std::vector<Level> levels_;               // level 0 is not used
  std::vector<MemberPool::Handle> block_;   // of the block that is being closed
  std::vector<MortonKey> keys_;             // theirs
  std::vector<dvec3> positions_;            // and where
  std::vector<std::uint32_t> owners_;       // and with which of them each goes
  Clusters clusters_;                       // so
  std::vector<BoundaryPlane> planes_;       // of the members of a cluster
  std::vector<dvec3> shifts_;               // and where
  std::vector<MemberPool::Handle> merged_;  // of the level whose blocks are being closed: what goes on
  std::vector<MemberPool::Handle> done_;    // what does not
};

}  // namespace splatvol
