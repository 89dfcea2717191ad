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

/// Collects points and splats into rows: a queue of rows for each segment at each level that draws it. Rows that are
/// not complete are written out if they take too much memory.
class RowCollector {
 public:
  /// `info`: attributes and columns. `memory`: bytes of rows to hold; rows that are being packed come on top. `folder`:
  /// for the rest. The rows do not depend on memory.
  RowCollector(const format::VolumeInfo& info, GroupSizes points_per_chunk,
               std::size_t memory = std::numeric_limits<std::size_t>::max(), std::string folder = {},
               SharedRows shared = {});
  RowCollector(const RowCollector&) = delete;
  RowCollector& operator=(const RowCollector&) = delete;

  /// Adds the next points of segment 0, with their splats at level 0.
  void add_finest(const SplatColumns& splats);

  /// Adds a whole row of segment 0 at level 0. Requires that all rows before it are whole.
  void add_packed_finest(PackedRow row);

  /// Adds the next point of a segment, with its splats at all levels that draw it.
  void add_point(std::size_t segment, const Member& member);

  /// Replaces `rows`, which have been written, by the rows that are complete. Rows have to be written in this order. It
  /// is enough to call this now and then.
  [[nodiscard]] Status extract_complete(std::vector<PendingRow>& rows) { return extract(rows, false); }

  /// Extracts all rows that are left; this must outlive them. Called once, after the last point.
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
  [[nodiscard]] Status write_out_open_rows();
  [[nodiscard]] Status write_out(PendingRow& row);
  [[nodiscard]] Status read_back(PendingRow& row);
  [[nodiscard]] std::size_t spare_memory() const { return memory_ / 8; }
  [[nodiscard]] std::size_t row_bytes() const { return points_per_chunk_.largest() * splat_bytes_; }

  std::size_t attributes_;
  GroupSizes points_per_chunk_;
  std::size_t memory_;
  std::string folder_;
  SharedRows shared_;
  std::size_t splat_bytes_;
  std::unique_ptr<TempFile> spool_;                   // null until something is written out
  std::vector<std::vector<Queue>> queues_;            // [segment][level]
  std::vector<std::unique_ptr<SplatColumns>> spare_;  // empty ones, whose memory the next rows use
  Ends ends_;
};

}  // namespace splatvol
