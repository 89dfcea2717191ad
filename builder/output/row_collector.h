// Rows of all resolutions at once, as a pass over the points fills them.
#pragma once

#include <cstddef>
#include <cstdint>
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

/// Collects points and splats into rows: an open row for each segment at each level that draws it. Open rows are
/// written out if they take too much memory.
class RowCollector {
 public:
  /// `info`: attributes and columns. `memory`: bytes of rows to hold; rows that are being packed come on top. `folder`:
  /// for the rest. The rows do not depend on memory.
  RowCollector(const format::VolumeInfo& info, GroupSizes points_per_chunk,
               std::size_t memory = std::numeric_limits<std::size_t>::max(), std::string folder = {},
               SharedRows shared = {});
  RowCollector(const RowCollector&) = delete;
  RowCollector& operator=(const RowCollector&) = delete;

  /// Adds the next points of segment 0, with their splats at level 0, and leaves anything in `splats`. Requires that no
  /// row ends between them.
  void add_finest(SplatColumns& splats);

  /// Adds a whole row of segment 0 at level 0. Requires that all rows before it are whole.
  void add_packed_finest(PackedRow row);

  /// Adds the next point of a segment, with its splats at all levels that draw it.
  void add_point(std::size_t segment, const Member& member);

  /// Replaces `rows`, which have been written, by the rows that are complete. Rows have to be written in this order. It
  /// is enough to call this now and then.
  [[nodiscard]] Status extract_complete(std::vector<PendingRow>& rows);

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
  std::vector<PendingRow>& open_rows(std::size_t segment);
  void close_rows(std::size_t segment);
  void recycle(std::vector<PendingRow>& rows);
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
  bool gradients_;
  std::size_t splat_bytes_;
  std::unique_ptr<TempFile> spool_;                   // null until something is written out
  std::vector<std::vector<PendingRow>> open_;         // [segment][level], or empty: all of a segment are equally full
  std::vector<PendingRow> complete_;                  // in the order of each segment and level
  std::vector<std::unique_ptr<SplatColumns>> spare_;  // empty ones, whose memory the next rows use
  Ends ends_;
};

}  // namespace splatvol
