#include "builder/reduction/cascade.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <ranges>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {

void MemberPool::acquire(std::size_t count, std::vector<Handle>& members) {
  {
    const tbb::spin_mutex::scoped_lock lock(mutex_);
    const std::size_t kept = free_.size() - std::min(count, free_.size());
    const auto first = free_.begin() + static_cast<std::ptrdiff_t>(kept);
    members.insert(members.end(), std::move_iterator(first), std::move_iterator(free_.end()));
    free_.resize(kept);
  }
  while (members.size() < count) members.push_back(std::make_unique<Member>());
}

void MemberPool::release(std::vector<Handle>& members) {
  const tbb::spin_mutex::scoped_lock lock(mutex_);
  std::ranges::move(members, std::back_inserter(free_));
  members.clear();
}

void add_splats(std::span<const MemberPool::Handle> members, std::span<const format::Attribute> attributes) {
  for (; !members.empty(); members = members.subspan(std::min(members.size(), shapes_at_once))) {
    const std::size_t count = std::min(members.size(), shapes_at_once);
    std::array<const SpatialMoments*, shapes_at_once> moments{};
    for (std::size_t m = 0; m < count; ++m) moments[m] = &members[m]->moments;
    const auto shapes = shapes_of(std::span(moments).first(count));
    for (std::size_t m = 0; m < count; ++m) {
      Member& member = *members[m];
      member.splats.emplace_back(MadeBy{[&] {
        return make_stored_splat(member.point.position, member.point.error, member.moments, shapes[m], member.plane);
      }});
      for (std::size_t a = 0; a < attributes.size(); ++a)
        member.stored_values.emplace_back(
            MadeBy{[&] { return make_stored_value(member.values[a].moments, shapes[m], attributes[a]); }});
    }
  }
}

void Cascade::add_to_last(const Member& other) {
  Level& level = levels_[1];
  const MemberPool::Handle& handle = level.entries.back();
  Member& last = *handle;
  merge(last.moments, other.moments, dvec3(0));
  for (std::size_t a = 0; a < attributes_.size(); ++a) merge(last.values[a].moments, other.values[a].moments, dvec3(0));
  last.plane = merge_planes(std::array{last.plane, other.plane}, std::array{dvec3(0), dvec3(0)});
  const std::uint64_t number = last.splats.back().number;
  last.splats.pop_back();
  last.stored_values.resize(last.stored_values.size() - attributes_.size());
  add_splats({&handle, 1}, attributes_);
  last.splats.back().number = number;
}

void Cascade::push(std::size_t level, MemberPool::Handle member) {
  if (level == part_.end) {
    sink_.beyond(*member);
    member->clear();
    return done_.push_back(std::move(member));
  }
  Level& at = levels_[level];
  member->splats.back().number = at.count++;
  at.entries.push_back(std::move(member));
}

void Cascade::close_nodes(bool at_end) {
  for (std::size_t level = part_.first; level < levels_.size() && levels_[level].count > 0; ++level) {
    if (!at_end && !reduces(levels_[level])) return;
    close_nodes(level, at_end);
    add_splats(merged_, attributes_);
    for (MemberPool::Handle& member : merged_) push(level + 1, std::move(member));
    merged_.clear();
    pool_.release(done_);
  }
}

// The first member's node is known once there are enough members behind it to split any larger node. It is whole then,
// too, because no two members share a finest node.
void Cascade::close_nodes(std::size_t level, bool at_end) {
  Level& at = levels_[level];
  const auto key = [&](std::size_t m) -> const MortonKey& { return at.entries[m]->key; };
  while (!at.entries.empty() && (at_end || at.entries.size() > node_points_)) {
    int shared_before = at.before ? common_depth(*at.before, key(0)) : part_.borders.shared_before(key(0));
    if (at.entries.size() <= node_points_) shared_before = std::max(shared_before, part_.borders.shared_behind(key(0)));
    const KeyLeaf node = leaf_at(key, 0, at.entries.size(), node_points_, shared_before);
    prefetch_next(at, node.end);
    close_node(level, node.end, node.depth);
  }
}

// Prefetches members behind the first `size`.
void Cascade::prefetch_next(const Level& level, std::size_t size) const {
  const std::size_t end = level.entries.size(), next = std::min(2 * size, end), after = std::min(next + 2 * size, end);
  for (std::size_t m = size; m < next; ++m) level.entries[m]->prefetch_vectors();
  for (std::size_t m = next; m < after; ++m) level.entries[m]->prefetch();
}

// Sets the octants of the splats of the first `size` members, which make up a node.
void Cascade::set_octants(const Level& level, std::size_t size, int depth) const {
  const auto key = [&](std::size_t m) -> const MortonKey& { return level.entries[m]->key; };
  for_each_leaf(key, 0, size, depth, leaf_points_, [&](std::size_t begin, std::size_t end, int octant_depth) {
    for (std::size_t m = begin; m < end; ++m) {
      StoredSplat& splat = level.entries[m]->splats.back();
      splat.depth = static_cast<std::uint8_t>(octant_depth);
      splat.count = static_cast<std::uint8_t>(std::min<std::size_t>(end - begin, 255));
    }
  });
}

void Cascade::close_node(std::size_t level, std::size_t size, int depth) {
  Level& at = levels_[level];
  set_octants(at, size, depth);
  node_members_.clear();
  for (std::size_t m = 0; m < size; ++m) {
    node_members_.push_back(std::move(at.entries.front()));
    sink_.splat(level, *node_members_.back(), depth);
    at.entries.pop_front();
  }
  at.before = node_members_.back()->key;
  if (reduces(at) && level + 1 < max_levels) reduce_node(depth);
  for (MemberPool::Handle& member : node_members_) {
    if (!member) continue;
    sink_.point(level, *member);
    member->clear();  // while it is in the cache
    done_.push_back(std::move(member));
  }
  node_members_.clear();
}

void Cascade::reduce_node(int depth) {
  if (method_ == Reduction::octree) {
    const std::size_t kept = nearest_to_center(cube_, depth, node_members_.size(),
                                               [&](std::size_t m) { return node_members_[m]->point.position; });
    return merge_cluster(std::views::iota(std::size_t{0}, node_members_.size()), kept);
  }
  node_keys_.clear();
  node_positions_.clear();
  for (const MemberPool::Handle& member : node_members_) {
    node_keys_.push_back(member->key);
    node_positions_.push_back(member->point.position);
  }
  node_owners_.resize(node_members_.size());
  find_clusters(method_, leaf_points_, node_keys_, node_positions_, node_owners_);
  clusters_.assign(node_owners_);
  for (std::size_t m = 0; m < node_owners_.size(); ++m)
    if (node_owners_[m] == m) merge_cluster(clusters_.of(m), m);
}

// Gives the material of all members to the one that goes on.
template <class Cluster>
void Cascade::merge_cluster(const Cluster& cluster, std::size_t kept) {
  Member& merged = *node_members_[kept];
  planes_.clear();
  shifts_.clear();
  for (const std::size_t m : cluster) {
    const Member& member = *node_members_[m];
    const dvec3 shift = member.point.position - merged.point.position;
    if (m != kept) {
      merge(merged.moments, member.moments, shift);
      for (std::size_t a = 0; a < merged.values.size(); ++a)
        merge(merged.values[a].moments, member.values[a].moments, shift);
    }
    if (member.plane.area == dvec3(0)) continue;
    planes_.push_back(member.plane);
    shifts_.push_back(shift);
  }
  if (!planes_.empty()) merged.plane = merge_planes(planes_, shifts_);
  merged_.push_back(std::move(node_members_[kept]));
}

std::uint64_t Cascade::first_open_leaf() const {
  std::uint64_t first = std::numeric_limits<std::uint64_t>::max();
  for (const Level& level : levels_)
    if (!level.entries.empty()) first = std::min(first, level.entries.front()->leaf);
  return first;
}

std::vector<std::uint64_t> Cascade::counts() const {
  std::vector<std::uint64_t> counts;
  for (std::size_t level = part_.first; level < levels_.size() && levels_[level].count > 0; ++level)
    counts.push_back(levels_[level].count);
  return counts;
}

}  // namespace splatvol
