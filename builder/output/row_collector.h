// Rows of all resolutions at once, as a pass over the points fills them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/output/density.h"
#include "builder/output/group_sizes.h"
#include "builder/output/member.h"
#include "builder/output/row_packer.h"
#include "builder/output/splat_columns.h"

namespace splatvol {

/// Points that are a range of all points in Morton order share rows with their neighbours.
struct SharedRows {
  std::vector<std::uint64_t> before;  // [segment]: points before the range; behind the end: 0
  bool ends_inside = false;           // more points follow behind the range
};

/// Collects points and splats into rows: a queue of rows for each segment at each level that draws it. It may also fit
/// the densities of level 0 (density.h), for which all rows of level 0 have to wait. Splats of coarser levels keep
/// density 1: a fit holds for one resolution, and most pictures mix resolutions (docs/accuracy.md).
///
/// Rows that are not complete, and packed rows that wait, are written out if they take too much memory.
class RowCollector {
 public:
  /// `info`: attributes and columns. `fits`: whether the densities of level 0 are to be fitted. `packer`: packs most of
  /// the rows that wait for their densities, so that they take less memory; may be null. `memory`: bytes of rows to
  /// hold; rows that are being packed, and splats whose densities are fitted, come on top. `folder`: for the rest. The
  /// rows do not depend on memory.
  RowCollector(const format::VolumeInfo& info, GroupSizes points_per_chunk, bool fits,
               const RowPacker* packer = nullptr, std::size_t memory = std::numeric_limits<std::size_t>::max(),
               std::string folder = {}, SharedRows shared = {});
  RowCollector(const RowCollector&) = delete;
  RowCollector& operator=(const RowCollector&) = delete;

  /// Makes room for the splats whose densities are fitted.
  void expect_splats(std::size_t count) { fitted_.reserve(count); }

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
  [[nodiscard]] Status extract_complete(std::vector<PendingRow>& rows) { return extract(rows, false); }

  /// Fits the densities, and extracts all rows that are left; this must outlive them. Called once, after the last
  /// point.
  [[nodiscard]] Result<std::vector<PendingRow>> extract_rest();

  /// The rows that began before the range, and those that end behind it; a row of both is among the first. They are not
  /// packed, and none of their splats is written out. Called once, after extract_rest().
  struct Ends {
    std::vector<PendingRow> first, last;
  };
  [[nodiscard]] Ends extract_ends() { return std::move(ends_); }

  /// Whether extract_complete() uses the memory of rows that have been written; else they had better be freed.
  [[nodiscard]] bool recycles() const { return spare_memory() >= row_bytes(); }

 private:
  using Queue = std::deque<PendingRow>;  // only the last row may be smaller than the others

  std::vector<Queue>& queues(std::size_t segment);
  [[nodiscard]] static std::size_t size_of(const PendingRow& row) {
    return row.absent + row.written_splats + row.splats->size();
  }
  [[nodiscard]] bool is_complete(const PendingRow& row) const;
  PendingRow& open_row(std::size_t segment, std::size_t level);
  void recycle(std::vector<PendingRow>& rows);
  [[nodiscard]] bool is_shared(const PendingRow& row) const {
    return row.absent > 0 || (shared_.ends_inside && !is_complete(row));
  }
  [[nodiscard]] Status extract(std::vector<PendingRow>& rows, bool at_end);
  [[nodiscard]] Status pack_waiting(Queue& queue);
  [[nodiscard]] Status write_out_open_rows();
  [[nodiscard]] Status write_out(PendingRow& row);
  [[nodiscard]] Status write_out_chunks(PendingRow& row);
  [[nodiscard]] Status read_back(PendingRow& row);
  [[nodiscard]] Status open_spool();
  [[nodiscard]] std::size_t spare_memory() const { return memory_ / 8; }
  [[nodiscard]] std::size_t row_bytes() const { return points_per_chunk_.largest() * splat_bytes_; }
  void fit();

  std::size_t attributes_;
  GroupSizes points_per_chunk_;
  bool fits_;
  const RowPacker* packer_;
  std::size_t memory_;
  std::string folder_;
  SharedRows shared_;
  std::size_t splat_bytes_;
  std::uint64_t waiting_bytes_ = 0;                   // of packed rows that are in memory
  std::unique_ptr<TempFile> spool_;                   // null until something is written out
  std::vector<std::vector<Queue>> queues_;            // [segment][level]
  std::vector<std::unique_ptr<SplatColumns>> spare_;  // empty ones, whose memory the next rows use
  Ends ends_;
  std::vector<FittedSplat> fitted_;  // [splat of level 0]; empty if nothing is fitted
};

}  // namespace splatvol
