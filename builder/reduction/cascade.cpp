#include "builder/reduction/cascade.h"

#include <algorithm>
#include <array>
#include <ranges>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {

Cascade::Cascade(const Cube& cube, Reduction method, std::uint32_t leaf_points,
                 std::span<const format::Attribute> attributes, Sink sink, CascadePart part)
    : cube_(cube),
      method_(method),
      leaf_points_(leaf_points),
      node_points_(most_in_reduction_node(method, leaf_points)),
      attributes_(attributes),
      sink_(std::move(sink)),
      part_(part) {
  for (std::size_t level = 0; level <= max_levels; ++level)
    levels_.push_back({Members(attributes.size(), level + 1), 0, std::nullopt});
}

void Cascade::push(const Member& member) {
  if (part_.first == part_.end) return sink_.beyond(member);
  Level& first = levels_[part_.first];
  first.members.add(member);
  ++first.count;
  constexpr std::size_t together = 64;  // they stay in the cache until their nodes are reduced
  if (first.members.size() > 2 * node_points_ + together) close_nodes(false);
}

void Cascade::add_to_last(const Member& other) {
  Members& members = levels_[part_.first].members;
  Member& last = members[members.size() - 1];
  merge(last.moments, other.moments, dvec3(0));
  for (std::size_t a = 0; a < attributes_.size(); ++a)
    merge(last.values()[a].moments, other.values()[a].moments, dvec3(0));
  last.plane = merge_planes(std::array{last.plane, other.plane}, std::array{dvec3(0), dvec3(0)});
  members.add_splats(members.size() - 1, attributes_);
}

void Cascade::close_nodes(bool at_end) {
  for (std::size_t level = part_.first; level < max_levels && levels_[level].count > 0; ++level) {
    if (!at_end && !reduces(level)) return;
    Level& next = levels_[level + 1];
    const std::size_t first = next.members.size();
    close_nodes(level, at_end);
    next.members.add_splats(first, attributes_);
    if (level + 1 < part_.end) {
      next.count += next.members.size() - first;
    } else {
      for (std::size_t m = first; m < next.members.size(); ++m) sink_.beyond(next.members[m]);
      next.members.clear();
    }
  }
}

// The first member's node is known once there are enough members behind it to split any larger node. It is whole then,
// too, because no two members share a finest node.
void Cascade::close_nodes(std::size_t level, bool at_end) {
  Level& at = levels_[level];
  const auto key = [&](std::size_t m) -> const MortonKey& { return at.members[m].key; };
  const std::size_t most_left = at_end ? 0 : node_points_;
  std::size_t begin = 0;
  for (const std::size_t end = at.members.size(); end - begin > most_left;) {
    int shared_before = at.before ? common_depth(*at.before, key(begin)) : part_.borders.shared_before(key(begin));
    if (end - begin <= node_points_) shared_before = std::max(shared_before, part_.borders.shared_behind(key(begin)));
    const KeyLeaf node = leaf_at(key, begin, end, node_points_, shared_before);
    close_node({level, begin, node.end, node.depth});
    begin = node.end;
  }
  at.members.erase_front(begin);
}

// Sets the octants of the splats of a node.
void Cascade::set_octants(const Node& node) {
  Members& members = levels_[node.level].members;
  const auto key = [&](std::size_t m) -> const MortonKey& { return members[m].key; };
  for_each_leaf(key, node.begin, node.end, node.depth, leaf_points_,
                [&](std::size_t begin, std::size_t end, int depth) {
                  for (std::size_t m = begin; m < end; ++m) {
                    StoredSplat& splat = members[m].splat(node.level);
                    splat.depth = static_cast<std::uint8_t>(depth);
                    splat.count = static_cast<std::uint8_t>(std::min<std::size_t>(end - begin, 255));
                  }
                });
}

void Cascade::close_node(const Node& node) {
  set_octants(node);
  Level& at = levels_[node.level];
  for (std::size_t m = node.begin; m < node.end; ++m) sink_.splat(node.level, at.members[m], node.depth);
  at.before = at.members[node.end - 1].key;
  constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
  node_owners_.assign(node.end - node.begin, none);
  if (reduces(node.level)) reduce_node(node);
  for (std::size_t m = 0; m < node_owners_.size(); ++m)
    if (node_owners_[m] != m) sink_.point(node.level, at.members[node.begin + m]);
}

void Cascade::reduce_node(const Node& node) {
  const Members& members = levels_[node.level].members;
  if (method_ == Reduction::octree) {
    const std::size_t kept = nearest_to_center(cube_, node.depth, node_owners_.size(),
                                               [&](std::size_t m) { return members[node.begin + m].point.position; });
    node_owners_[kept] = static_cast<std::uint32_t>(kept);
    return merge_cluster(node, std::views::iota(std::size_t{0}, node_owners_.size()), kept);
  }
  node_keys_.clear();
  node_positions_.clear();
  for (std::size_t m = node.begin; m < node.end; ++m) {
    node_keys_.push_back(members[m].key);
    node_positions_.push_back(members[m].point.position);
  }
  find_clusters(method_, leaf_points_, node_keys_, node_positions_, node_owners_);
  clusters_.assign(node_owners_);
  for (std::size_t m = 0; m < node_owners_.size(); ++m)
    if (node_owners_[m] == m) merge_cluster(node, clusters_.of(m), m);
}

// Makes the member of the next level that has the material of a cluster. Members are counted from the node's first.
template <class Cluster>
void Cascade::merge_cluster(const Node& node, const Cluster& cluster, std::size_t kept) {
  const Members& members = levels_[node.level].members;
  Member& merged = levels_[node.level + 1].members.add(members[node.begin + kept]);
  planes_.clear();
  shifts_.clear();
  for (const std::size_t m : cluster) {
    const Member& member = members[node.begin + m];
    const dvec3 shift = member.point.position - merged.point.position;
    if (m != kept) {
      merge(merged.moments, member.moments, shift);
      for (std::size_t a = 0; a < attributes_.size(); ++a)
        merge(merged.values()[a].moments, member.values()[a].moments, shift);
    }
    if (member.plane.area == dvec3(0)) continue;
    planes_.push_back(member.plane);
    shifts_.push_back(shift);
  }
  if (!planes_.empty()) merged.plane = merge_planes(planes_, shifts_);
}

std::uint64_t Cascade::first_open_leaf() const {
  std::uint64_t first = std::numeric_limits<std::uint64_t>::max();
  for (const Level& level : levels_)
    if (!level.members.empty()) first = std::min(first, level.members[0].leaf);
  return first;
}

std::vector<std::uint64_t> Cascade::counts() const {
  std::vector<std::uint64_t> counts;
  for (std::size_t level = part_.first; level < levels_.size() && levels_[level].count > 0; ++level)
    counts.push_back(levels_[level].count);
  return counts;
}

}  // namespace splatvol
