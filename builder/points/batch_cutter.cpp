#include "builder/points/batch_cutter.h"

#include <algorithm>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {

BatchCutter::BatchCutter(NextPoints next, std::size_t attributes, std::uint64_t index_leaf_points, BatchShape shape,
                         PointBorders borders)
    : next_(std::move(next)),
      index_leaf_points_(index_leaf_points),
      shape_(shape),
      borders_(borders),
      before_(borders.before) {
  held_.resize_attributes(attributes);
}

// Holds at least `points`, or all that are left, in memory that does not grow to twice as much.
Status BatchCutter::hold(std::size_t points) {
  while (!ended_ && held_.size() < points) {
    SPLATVOL_TRY_ASSIGN(more, next_(held_));
    ended_ = !more;
    for_each_array(held_, held_, [&](auto& array, auto&) {
      if (!array.empty()) array.reserve(points + points_at_once);
    });
  }
  return {};
}

// The node that begins with a held point, in the octree whose nodes hold at most `most` points; or `most` points of one
// key. Requires that more than `most` points from there on are held, or all.
NodePart BatchCutter::part_at(std::size_t begin, std::size_t most) const {
  const std::vector<MortonKey>& keys = held_.keys;
  const std::optional<MortonKey> before = begin > 0 ? keys[begin - 1] : last_;
  int shared_before = before ? common_depth(*before, keys[begin]) : borders_.keys.shared_before(keys[begin]);
  if (keys.size() - begin <= most) shared_before = std::max(shared_before, borders_.keys.shared_behind(keys[begin]));
  const KeyLeaf part = leaf_part_at(keys, begin, most, shared_before);
  return {begin, part.end, part.depth, 0, before == keys[begin]};
}

// Cuts a batch's points into estimate nodes, and returns where the last of these ends.
std::size_t BatchCutter::cut_estimate_nodes(std::size_t most, std::vector<NodePart>& parts) const {
  parts.clear();
  std::size_t end = 0;
  while (end < std::min(held_.size(), shape_.points)) {
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

// Moves the first `end` points to a batch.
void BatchCutter::extract_points(std::size_t end, PointBatch& batch) {
  batch.resize_attributes(held_.values.size());
  batch.before = before_;
  last_ = held_.keys[end - 1];
  before_ = held_.positions[end - 1];
  for_each_array(held_, batch, [&](auto& held, auto& extracted) {
    if (held.empty()) return;  // not known yet: the estimate writes over the material of the last batch
    const auto rest = held.begin() + static_cast<std::ptrdiff_t>(end);
    extracted.assign(held.begin(), rest);
    held.erase(held.begin(), rest);
  });
  batch.behind = held_.size() > 0 ? held_.positions.front() : borders_.behind;
}

Result<bool> BatchCutter::next(PointBatch& batch) {
  const std::size_t most = std::max(shape_.node_points, index_leaf_points_);
  SPLATVOL_TRY(hold(shape_.points + most + 1));
  if (held_.size() == 0) return false;
  const std::size_t end = cut_estimate_nodes(most, batch.estimate_parts);
  cut_index_leaves(batch.estimate_parts, batch.leaf_parts);
  extract_points(end, batch);
  batch.first = returned_;
  returned_ += batch.size();
  return true;
}

}  // namespace splatvol
