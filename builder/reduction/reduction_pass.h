// One pass over the points in Morton order, which makes all of the file's contents.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include "builder/output/index_stream.h"
#include "builder/output/row_collector.h"
#include "builder/reduction/batch_reduction.h"
#include "builder/reduction/cascade.h"

namespace splatvol {

/// Adds batches to rows and index leaves. One part of it grows with the number of points: the leaves for which splats
/// come late, a few thousandths of all.
class ReductionPass {
 public:
  /// `leaves` gets the index leaves in Morton order. At most `most_open_leaves` of them wait for coarser splats.
  /// References must outlive this.
  ReductionPass(const ReductionSettings& settings, RowCollector& rows,
                std::function<Status(const OpenIndexLeaf&)> leaves,
                std::uint64_t most_open_leaves = std::uint64_t{1} << 14);
  ReductionPass(const ReductionPass&) = delete;
  ReductionPass& operator=(const ReductionPass&) = delete;

  /// Clears `result`, and prepares it for reduce(). Requires batches in Morton order.
  void prepare(const PointBatch& batch, ReducedBatch& result);

  /// Reduces the leaf parts of a batch. Thread-safe, also beside prepare() and add().
  void reduce(const PointBatch& batch, ReducedBatch& result) { reduce_batch(batch, settings_, result); }

  /// Adds the next batch. Extracts the finest points from `reduced`.
  [[nodiscard]] Status add(const PointBatch& batch, ReducedBatch& reduced);

  /// Adds the next member of the first level of a part that has no points; its leaf has been returned elsewhere.
  void add_coarse(const Member& member) { cascade_.push(member); }

  /// Called after the last batch.
  [[nodiscard]] Status finish();

  /// Counts and splats that came for index leaves after `leaves` had got these, by the leaf's number: clusters of the
  /// coarsest levels are whole long after most of their points have passed. Requires finish().
  [[nodiscard]] const std::map<std::uint64_t, OpenIndexLeaf>& late_leaves() const { return late_leaves_; }

  /// Points of each level, those of the finest first; of the levels from the first on, if the part has no points.
  [[nodiscard]] std::vector<std::uint64_t> counts() const;

 private:
  void add_members(const PointBatch& batch, ReducedBatch& reduced);
  [[nodiscard]] Status close_leaves(std::uint64_t end);
  OpenIndexLeaf& leaf(std::uint64_t number);

  const ReductionSettings& settings_;
  RowCollector& rows_;
  std::function<Status(const OpenIndexLeaf&)> leaves_;
  std::uint64_t most_open_leaves_;
  Cascade cascade_;
  Status stays_;          // of ReductionSettings::stays
  std::uint64_t finest_;  // points that no coarser level has, up to the last batch that is prepared
  std::uint64_t points_ = 0;
  std::deque<OpenIndexLeaf> open_leaves_;
  std::uint64_t first_leaf_ = 0;  // number of the first open one
  std::map<std::uint64_t, OpenIndexLeaf> late_leaves_;
};

}  // namespace splatvol
