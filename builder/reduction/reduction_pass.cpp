#include "builder/reduction/reduction_pass.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace splatvol {

ReductionPass::ReductionPass(const ReductionSettings& settings, RowCollector& rows,
                             std::function<Status(const OpenIndexLeaf&)> leaves, std::uint64_t most_open_leaves)
    : settings_(settings),
      rows_(rows),
      leaves_(std::move(leaves)),
      most_open_leaves_(most_open_leaves),
      cascade_(settings.cube, settings.method, settings.leaf_points, settings.attributes,
               {[this](std::size_t level, const Member& member, int node_depth) {
                  SplatBounds& bounds = leaf(member.leaf).splats_at(level);
                  bounds.include(member.splat(level), member.moments);
                  bounds.least_depth = std::min(bounds.least_depth, static_cast<std::uint8_t>(node_depth));
                },
                [this](std::size_t level, const Member& member) {
                  leaf(member.leaf).count(level);
                  rows_.add_point(level, member);
                  if (settings_.stays && stays_) stays_ = settings_.stays(level, member.number);
                },
                settings.beyond},
               settings.part),
      finest_(settings.finest_before) {
  if (settings.part.first > 1) first_leaf_ = std::numeric_limits<std::uint64_t>::max();
}

void ReductionPass::prepare(const PointBatch& batch, ReducedBatch& result) {
  result.clear();
  result.first_finest = finest_;
  finest_ += find_leaves(batch, settings_, result);
}

Status ReductionPass::add(const PointBatch& batch, ReducedBatch& reduced) {
  rows_.add_finest(reduced.finest);
  for (PackedRow& row : reduced.packed) rows_.add_packed_finest(std::move(row));
  rows_.add_finest(reduced.tail);
  add_members(batch, reduced);
  points_ += batch.size();
  const std::uint64_t end = first_leaf_ + open_leaves_.size();
  const std::uint64_t before_last = end > 0 ? end - 1 : 0;  // the last may be continued
  SPLATVOL_TRY(stays_);
  const std::uint64_t too_old = end > most_open_leaves_ ? end - most_open_leaves_ : 0;
  return close_leaves(std::min(std::max(cascade_.first_open_leaf(), too_old), before_last));
}

void ReductionPass::add_members(const PointBatch& batch, ReducedBatch& reduced) {
  std::size_t m = 0;
  for (std::size_t p = 0; p < batch.leaf_parts.size(); ++p) {
    const NodePart& part = batch.leaf_parts[p];
    ReducedBatch::LeafPart& added = reduced.leaf_parts[p];
    if (part.continued)
      leaf(part.leaf).include(added.leaf);
    else
      open_leaves_.push_back(std::move(added.leaf));
    for (; m < added.members_end; ++m) {
      if (part.continued)
        cascade_.add_to_last(reduced.members[m]);
      else
        cascade_.push(reduced.members[m]);
    }
  }
}

OpenIndexLeaf& ReductionPass::leaf(std::uint64_t number) {
  return number < first_leaf_ ? late_leaves_[number] : open_leaves_[number - first_leaf_];
}

Status ReductionPass::close_leaves(std::uint64_t end) {
  for (; first_leaf_ < end; ++first_leaf_) {
    SPLATVOL_TRY(leaves_(open_leaves_.front()));
    open_leaves_.pop_front();
  }
  return {};
}

Status ReductionPass::finish() {
  cascade_.finish();
  SPLATVOL_TRY(stays_);
  return close_leaves(first_leaf_ + open_leaves_.size());
}

std::vector<std::uint64_t> ReductionPass::counts() const {
  std::vector<std::uint64_t> counts = cascade_.counts();
  if (settings_.part.first == 1) counts.insert(counts.begin(), points_);
  return counts;
}

}  // namespace splatvol
