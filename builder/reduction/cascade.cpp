#include "builder/reduction/cascade.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <ranges>
#include <utility>

namespace splatvol {

void MemberPool::take(std::size_t count, std::vector<Handle>& members) {
  {
    const tbb::spin_mutex::scoped_lock lock(mutex_);
    const std::size_t kept = free_.size() - std::min(count, free_.size());
    const auto first = free_.begin() + static_cast<std::ptrdiff_t>(kept);
    members.insert(members.end(), std::move_iterator(first), std::move_iterator(free_.end()));
    free_.resize(kept);
  }
  while (members.size() < count) members.push_back(std::make_unique<Member>());
}

void MemberPool::give_back(std::vector<Handle>& members) {
  const tbb::spin_mutex::scoped_lock lock(mutex_);
  std::ranges::move(members, std::back_inserter(free_));
  members.clear();
}

void add_splats(std::span<const MemberPool::Handle> members, std::span<const double> offsets) {
  for (; !members.empty(); members = members.subspan(std::min(members.size(), shapes_at_once))) {
    const std::size_t count = std::min(members.size(), shapes_at_once);
    std::array<const SpatialMoments*, shapes_at_once> moments{};
    for (std::size_t m = 0; m < count; ++m) moments[m] = &members[m]->moments;
    const auto shapes = shapes_of(std::span(moments).first(count));
    for (std::size_t m = 0; m < count; ++m) {
      Member& member = *members[m];
      member.splats.emplace_back(InPlace{[&] {
        return make_splat_row(member.point.position, member.point.error, member.moments, shapes[m], member.plane);
      }});
      for (std::size_t a = 0; a < offsets.size(); ++a)
        member.value_rows.emplace_back(
            InPlace{[&] { return make_value_row(member.values[a].moments, shapes[m], offsets[a]); }});
    }
  }
}

void Cascade::add_to_last(const Member& other) {
  Level& level = levels_[1];
  const MemberPool::Handle& handle = level.entries.back();
  Member& last = *handle;
  merge(last.moments, other.moments, dvec3(0));
  for (std::size_t a = 0; a < offsets_.size(); ++a) merge(last.values[a].moments, other.values[a].moments, dvec3(0));
  last.plane = merge_planes(std::array{last.plane, other.plane}, std::array{dvec3(0), dvec3(0)});
  const std::uint64_t number = last.splats.back().number;
  last.splats.pop_back();
  last.value_rows.resize(last.value_rows.size() - offsets_.size());
  add_splats({&handle, 1}, offsets_);
  last.splats.back().number = number;
}

void Cascade::push(std::size_t level, MemberPool::Handle member) {
  Level& at = levels_[level];
  member->splats.back().number = at.count++;
  at.entries.push_back(std::move(member));
}

void Cascade::close_nodes(bool at_end) {
  for (std::size_t level = 1; level < levels_.size() && levels_[level].count > 0; ++level) {
    if (!at_end && !levels_[level].reduces()) return;
    close_nodes(level, at_end);
    add_splats(merged_, offsets_);
    for (MemberPool::Handle& member : merged_) push(level + 1, std::move(member));
    merged_.clear();
    pool_.give_back(done_);
  }
}

// The first member's block is known once there are enough behind it to split any larger cell; it is whole then too, as
// no two members share the finest cell.
void Cascade::close_nodes(std::size_t level, bool at_end) {
  Level& at = levels_[level];
  const auto key = [&](std::size_t m) -> const MortonKey& { return at.entries[m]->key; };
  while (!at.entries.empty() && (at_end || at.entries.size() > node_points_)) {
    const MortonKey& first = key(0);
    const MortonKey* beyond = at.entries.size() > node_points_ ? &key(node_points_) : nullptr;
    const int depth = leaf_depth(at.before ? common_depth(*at.before, first) : -1, first, beyond);
    std::size_t size = 1;
    while (size < at.entries.size() && common_depth(first, key(size)) >= depth) ++size;
    prefetch_next(at, size);
    close_node(level, size, depth);
  }
}

// What is behind a block of so many.
void Cascade::prefetch_next(const Level& level, std::size_t size) const {
  const std::size_t end = level.entries.size(), next = std::min(2 * size, end), after = std::min(next + 2 * size, end);
  for (std::size_t m = size; m < next; ++m) level.entries[m]->prefetch_vectors();
  for (std::size_t m = next; m < after; ++m) level.entries[m]->prefetch();
}

void Cascade::close_node(std::size_t level, std::size_t size, int depth) {
  Level& at = levels_[level];
  block_.clear();
  const auto key = [&](std::size_t m) -> const MortonKey& { return at.entries[m]->key; };
  for_each_leaf(key, 0, size, depth, leaf_points_, [&](std::size_t begin, std::size_t end, int octant_depth) {
    for (std::size_t m = begin; m < end; ++m) {
      SplatRow& splat = at.entries[m]->splats.back();
      splat.depth = static_cast<std::uint8_t>(octant_depth);
      splat.count = static_cast<std::uint8_t>(std::min<std::size_t>(end - begin, 255));
    }
  });
  for (std::size_t m = 0; m < size; ++m) {
    block_.push_back(std::move(at.entries.front()));
    sink_.splat(level, *block_.back(), depth);
    at.entries.pop_front();
  }
  at.before = block_.back()->key;
  if (at.reduces() && level + 1 < max_levels) reduce_node(depth);
  for (MemberPool::Handle& member : block_) {
    if (!member) continue;
    sink_.point(level, *member);
    member->clear();  // here, while it is in the cache
    done_.push_back(std::move(member));
  }
  block_.clear();
}

void Cascade::reduce_node(int depth) {
  if (method_ == Reduction::octree) {
    const std::size_t kept =
        nearest_to_center(cube_, depth, block_.size(), [&](std::size_t m) { return block_[m]->point.position; });
    return merge_cluster(std::views::iota(std::size_t{0}, block_.size()), kept);
  }
  keys_.clear();
  positions_.clear();
  for (const MemberPool::Handle& member : block_) {
    keys_.push_back(member->key);
    positions_.push_back(member->point.position);
  }
  owners_.resize(block_.size());
  find_clusters(method_, leaf_points_, keys_, positions_, owners_);
  clusters_.assign(owners_);
  for (std::size_t m = 0; m < owners_.size(); ++m)
    if (owners_[m] == m) merge_cluster(clusters_.of(m), m);
}

// The member that goes on gets the material of all.
template <class Cluster>
void Cascade::merge_cluster(const Cluster& cluster, std::size_t kept) {
  Member& merged = *block_[kept];
  planes_.clear();
  shifts_.clear();
  for (const std::size_t m : cluster) {
    const Member& member = *block_[m];
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
  merged_.push_back(std::move(block_[kept]));
}

std::uint64_t Cascade::first_open_leaf() const {
  std::uint64_t first = std::numeric_limits<std::uint64_t>::max();
  for (const Level& level : levels_)
    if (!level.entries.empty()) first = std::min(first, level.entries.front()->leaf);
  return first;
}

std::vector<std::uint64_t> Cascade::counts() const {
  std::vector<std::uint64_t> counts;
  for (std::size_t level = 1; level < levels_.size() && levels_[level].count > 0; ++level)
    counts.push_back(levels_[level].count);
  return counts;
}

}  // namespace splatvol
