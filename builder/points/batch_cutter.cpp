#include "builder/points/batch_cutter.h"

#include <algorithm>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {

BatchCutter::BatchCutter(NextPoints next, std::size_t attributes, std::uint64_t index_leaf_points, BatchShape shape,
                         PointBorders borders)
    : next_(std::move(next)), index_leaf_points_(index_leaf_points), shape_(shape), borders_(borders) {
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

// The node that begins with a held point, in the octree whose nodes hold at most `most` points; or `most` points of one
// key. Requires that more than `most` points from there on are held, or all.
NodePart BatchCutter::part_at(std::size_t begin, std::size_t most) const {
  const std::vector<MortonKey>& keys = held_.keys;
  int shared_before = begin > 0 ? common_depth(keys[begin - 1], keys[begin]) : borders_.keys.shared_before(keys[begin]);
  if (keys.size() - begin <= most) shared_before = std::max(shared_before, borders_.keys.shared_behind(keys[begin]));
  const KeyLeaf part = leaf_part_at(keys, begin, most, shared_before);
  return {begin, part.end, part.depth, 0, begin > 0 && keys[begin - 1] == keys[begin]};
}

// Cuts a batch's points into estimate nodes, and returns where the last of these ends.
std::size_t BatchCutter::cut_estimate_nodes(std::size_t most, std::vector<NodePart>& parts) const {
  parts.clear();
  std::size_t end = begin_;
  while (end < held_.size() && end - begin_ < shape_.points) {
    parts.push_back(part_at(end, most));
    end = parts.back().end;
  }
  return end;
}

// Every estimate node ends an index leaf, or a part of one: the points of one key may go on in the next batch, and
// where batches end must not matter.
void BatchCutter::cut_index_leaves(std::span<const NodePart> nodes, std::vector<NodePart>& parts) {
  parts.clear();
  for (const NodePart& node : nodes)
    for (std::size_t begin = node.begin; begin < node.end; begin = parts.back().end) {
      NodePart part = part_at(begin, index_leaf_points_);
      part.end = std::min(part.end, node.end);
      if (!part.continued) ++leaves_;
      part.leaf = leaves_ - 1;
      parts.push_back(part);
    }
}

void BatchCutter::copy_points(std::size_t end, PointBatch& batch) const {
  batch.resize_attributes(held_.values.size());
  for_each_array(held_, batch, [&](const auto& from, auto& to) {
    if (from.empty()) return;  // not known yet: the estimate writes over the material of the last batch
    to.assign(from.begin() + static_cast<std::ptrdiff_t>(begin_), from.begin() + static_cast<std::ptrdiff_t>(end));
  });
  batch.before = begin_ > 0 ? std::optional(held_.positions[begin_ - 1]) : borders_.before;
  batch.behind = end < held_.size() ? std::optional(held_.positions[end]) : borders_.behind;
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
  const std::size_t most = std::max(shape_.node_points, index_leaf_points_);
  SPLATVOL_TRY(hold(shape_.points + most + 1));
  if (begin_ == held_.size()) return false;
  const std::size_t end = cut_estimate_nodes(most, batch.estimate_parts);
  cut_index_leaves(batch.estimate_parts, batch.leaf_parts);
  copy_points(end, batch);
  for (auto* parts : {&batch.estimate_parts, &batch.leaf_parts})
    for (NodePart& part : *parts) part.begin -= begin_, part.end -= begin_;
  batch.first = returned_;
  returned_ += batch.size();
  begin_ = end;
  forget_returned_points();
  return true;
}

}  // namespace splatvol
