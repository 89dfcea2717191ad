#include "builder/points/batch_cutter.h"

#include <algorithm>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {

BatchCutter::BatchCutter(NextPoints next, std::size_t attributes, std::uint64_t index_leaf_points, BatchShape shape)
    : next_(std::move(next)), index_leaf_points_(index_leaf_points), shape_(shape) {
  held_.resize_attributes(attributes);
}

// Holds at least `points` that have not been returned, or all that are left.
Status BatchCutter::hold(std::size_t points) {
  while (!ended_ && held_.size() - begin_ < points) {
    SPLATVOL_TRY_ASSIGN(more, next_(held_));
    ended_ = !more;
  }
  return {};
}

// The index leaf that begins with a held point, or so many points of it as a leaf may hold if they share one key.
// Requires that more points from there on are held, or all.
NodePart BatchCutter::part_at(std::size_t begin) const {
  const std::vector<MortonKey>& keys = held_.keys;
  const int shared_before = begin > 0 ? common_depth(keys[begin - 1], keys[begin]) : -1;
  const KeyLeaf part = leaf_part_at(keys, begin, index_leaf_points_, shared_before);
  return {begin, part.end, part.depth, 0, begin > 0 && keys[begin - 1] == keys[begin]};
}

// Cuts a batch's points into index leaves, and returns where the last of these ends.
std::size_t BatchCutter::cut_index_leaves(std::vector<NodePart>& parts) {
  parts.clear();
  std::size_t end = begin_;
  while (end < held_.size() && end - begin_ < shape_.points) {
    NodePart part = part_at(end);
    if (!part.continued) ++leaves_;
    part.leaf = leaves_ - 1;
    end = part.end;
    parts.push_back(part);
  }
  return end;
}

void BatchCutter::copy_points(std::size_t end, PointBatch& batch) const {
  batch.resize_attributes(held_.values.size());
  for_each_array(held_, batch, [&](const auto& from, auto& to) {
    if (from.empty()) return to.clear();  // planes or gradients
    to.assign(from.begin() + static_cast<std::ptrdiff_t>(begin_), from.begin() + static_cast<std::ptrdiff_t>(end));
  });
  batch.before = begin_ > 0 ? std::optional(held_.positions[begin_ - 1]) : std::nullopt;
  batch.behind = end < held_.size() ? std::optional(held_.positions[end]) : std::nullopt;
}

// Keeps the last point that was returned: the next nodes depend on its key.
void BatchCutter::forget_returned_points() {
  for_each_array(held_, held_, [&](auto& items, auto&) {
    items.erase(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(
                                                   std::min(begin_ - std::min<std::size_t>(begin_, 1), items.size())));
  });
  begin_ = std::min<std::size_t>(begin_, 1);
}

Result<bool> BatchCutter::next(PointBatch& batch) {
  SPLATVOL_TRY(hold(shape_.points + index_leaf_points_ + 1));
  if (begin_ == held_.size()) return false;
  const std::size_t end = cut_index_leaves(batch.leaf_parts);
  copy_points(end, batch);
  for (NodePart& part : batch.leaf_parts) part.begin -= begin_, part.end -= begin_;
  batch.first = returned_;
  returned_ += batch.size();
  begin_ = end;
  forget_returned_points();
  return true;
}

}  // namespace splatvol
