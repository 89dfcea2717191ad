// Rows of all resolutions at once, as a pass over the points fills them.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "builder/output/density.h"
#include "builder/output/group_sizes.h"
#include "builder/output/member.h"
#include "builder/output/row_packer.h"
#include "builder/output/splat_columns.h"

namespace splatvol {

/// Collects points and splats into rows: a queue of rows for each segment at each level that draws it. It may also fit
/// the densities of level 0 (density.h), for which all rows of level 0 have to wait. Splats of coarser levels keep
/// density 1: a fit holds for one resolution, and most pictures mix resolutions (docs/accuracy.md).
class RowCollector {
 public:
  /// `fits`: whether the densities of level 0 are to be fitted. `packer`: packs most of the rows that wait for their
  /// densities, so that they take less memory; may be null.
  RowCollector(std::size_t attributes, GroupSizes points_per_chunk, bool fits, const RowPacker* packer = nullptr)
      : attributes_(attributes), points_per_chunk_(std::move(points_per_chunk)), fits_(fits), packer_(packer) {}
  RowCollector(const RowCollector&) = delete;
  RowCollector& operator=(const RowCollector&) = delete;

  /// Adds the next splat of level 0 in Morton order. Only needed if densities are fitted.
  void add_splat(const StoredSplat& splat) { fitted_.push_back({splat.centroid, splat.shape}); }

  /// Adds the next points of segment 0, with their splats at level 0.
  void add_finest(const SplatColumns& splats);

  /// Adds a whole row of segment 0 at level 0. Requires that densities are not fitted, and that all rows before it are
  /// whole.
  void add_packed_finest(PackedRow row);

  /// Adds the next point of a segment, with its splats at all levels that draw it.
  void add_point(std::size_t segment, const Member& member);

  /// Replaces `rows`, which have been written, by the rows that are complete. Rows have to be written in this order. It
  /// is enough to call this now and then.
  void extract_complete(std::vector<PendingRow>& rows) { extract(rows, false); }

  /// Fits the densities, and extracts all rows that are left. Called once, after the last point.
  [[nodiscard]] std::vector<PendingRow> extract_rest();

 private:
  using Queue = std::deque<PendingRow>;  // only the last row may be smaller than the others

  std::vector<Queue>& queues(std::size_t segment);
  [[nodiscard]] bool is_complete(const PendingRow& row) const;
  SplatColumns& open_row(std::size_t segment, std::size_t level);
  void recycle(std::vector<PendingRow>& rows);
  void extract(std::vector<PendingRow>& rows, bool at_end);
  void pack_waiting(Queue& queue) const;
  void fit();

  std::size_t attributes_;
  GroupSizes points_per_chunk_;
  bool fits_;
  const RowPacker* packer_;
  std::vector<std::vector<Queue>> queues_;            // [segment][level]
  std::vector<std::unique_ptr<SplatColumns>> spare_;  // empty ones, whose memory the next rows use
  std::vector<FittedSplat> fitted_;                   // [splat of level 0]; empty if nothing is fitted
};

}  // namespace splatvol
