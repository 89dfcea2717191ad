#include "builder/distributed/level_counts.h"

#include <algorithm>

namespace splatvol {

void LevelCounts::add(const PointBatch& batch) {
  for (std::size_t i = 0; i < batch.size(); ++i) {
    const MortonKey& key = batch.keys[i];
    of_last_key_ = last_ == key ? of_last_key_ + 1 : 1;
    last_ = key;
    // All points of such a leaf have one key, and the first of them tell which one stays.
    if (of_last_key_ > most_of_one_key_)
      count(levels_[0], key);
    else
      push(0, {key, batch.positions[i]});
  }
  close_leaves(false);
}

std::vector<std::vector<std::uint64_t>> LevelCounts::intervals() const {
  std::vector<std::vector<std::uint64_t>> all;
  for (const Level& level : levels_) {
    all.push_back(level.counts);
    all.back().resize(marks_.size() + 1);
  }
  return all;
}

void LevelCounts::count(Level& level, const MortonKey& key) {
  level.counts.resize(marks_.size() + 1);
  while (level.mark < marks_.size() && marks_[level.mark] <= key) ++level.mark;
  ++level.counts[level.mark];
}

void LevelCounts::push(std::size_t level, const Entry& entry) {
  count(levels_[level], entry.key);
  levels_[level].entries.push_back(entry);
}

void LevelCounts::close_leaves(bool at_end) {
  for (std::size_t level = 0; level + 1 < levels_.size() && !levels_[level].entries.empty(); ++level)
    close_leaves(level, at_end);
}

// As Cascade does; but points may share a key, and are a leaf of any size then, whose end must have been seen.
void LevelCounts::close_leaves(std::size_t level, bool at_end) {
  Level& at = levels_[level];
  const auto key = [&](std::size_t i) -> const MortonKey& { return at.entries[i].key; };
  while (!at.entries.empty() && (at_end || at.entries.size() > leaf_points_)) {
    int shared = at.before ? common_depth(*at.before, key(0)) : borders_.shared_before(key(0));
    if (at.entries.size() <= leaf_points_) shared = std::max(shared, borders_.shared_behind(key(0)));
    const KeyLeaf leaf = leaf_at(key, 0, at.entries.size(), leaf_points_, shared);
    if (leaf.end == at.entries.size() && leaf.end > leaf_points_ && !at_end) return;
    const std::size_t kept =
        nearest_to_center(cube_, leaf.depth, leaf.end, [&](std::size_t i) { return at.entries[i].position; });
    const Entry stays = at.entries[kept];
    at.before = key(leaf.end - 1);
    at.entries.erase(at.entries.begin(), at.entries.begin() + static_cast<std::ptrdiff_t>(leaf.end));
    push(level + 1, stays);
  }
}

}  // namespace splatvol
