// One pass over the points in Morton order that gives everything the file holds.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include "builder/output/index_stream.h"
#include "builder/output/row_streams.h"
#include "builder/reduction/batch_reduction.h"
#include "builder/reduction/cascade.h"
#include "format/volume_writer.h"

namespace splatvol {

/// Takes batches, fills rows and index leaves. Nothing in it grows with the number of points but the splats of the
/// finest level where their densities are fitted, and what comes late for index leaves, a few thousandths of them.
class ReductionPass {
 public:
  /// `leaves` gets the index's leaves in Morton order, counts and splats by levels; at most so many wait for what is
  /// still to come for them. References must outlive this.
  ReductionPass(const ReductionSettings& settings, RowStreams& rows, std::function<Status(const OpenIndexLeaf&)> leaves,
                std::uint64_t most_open_leaves = std::uint64_t{1} << 14);
  ReductionPass(const ReductionPass&) = delete;
  ReductionPass& operator=(const ReductionPass&) = delete;

  /// Before the next points are reduced; what `result` held is gone.
  void prepare(const PointBatch& batch, ReducedBatch& result);

  /// Reduces the cells of a batch. Thread-safe, also beside prepare() and take().
  void reduce(const PointBatch& batch, ReducedBatch& result) { reduce_batch(batch, settings_, pool_, result); }

  /// The next points, and what their cells come to, of which members are taken out.
  [[nodiscard]] Status take(const PointBatch& batch, ReducedBatch& reduced);

  /// After the last.
  [[nodiscard]] Status finish();

  /// What came for leaves after they were given out, by their numbers: clusters of the coarsest levels are whole long
  /// after most of their points have passed. After finish().
  [[nodiscard]] const std::map<std::uint64_t, OpenIndexLeaf>& late_leaves() const { return late_leaves_; }

  /// Points of each level, from the finest on.
  [[nodiscard]] std::vector<std::uint64_t> counts() const;
  [[nodiscard]] const format::Histograms& histograms() const { return histograms_; }
  [[nodiscard]] const std::vector<std::uint64_t>& missing() const { return missing_; }  // [attribute]

 private:
  [[nodiscard]] Status close_leaves(std::uint64_t end);
  OpenIndexLeaf& leaf(std::uint64_t number);

  const ReductionSettings& settings_;
  RowStreams& rows_;
  std::function<Status(const OpenIndexLeaf&)> leaves_;
  std::uint64_t most_open_leaves_;
  MemberPool pool_;
  Cascade cascade_;
  std::uint64_t finest_ = 0;  // points that no coarser level has, of all that are prepared
  std::uint64_t points_ = 0;
  std::deque<OpenIndexLeaf> open_leaves_;
  std::uint64_t first_leaf_ = 0;  // number of the first open one
  std::map<std::uint64_t, OpenIndexLeaf> late_leaves_;
  format::Histograms histograms_;
  std::vector<std::uint64_t> missing_;
};

}  // namespace splatvol
