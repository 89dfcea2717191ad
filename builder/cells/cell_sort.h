// Cells of one shape in the order of their corners, out of memory.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/cells/polyhedra.h"
#include "builder/sorting/external_sort.h"
#include "format/cells.h"

namespace splatvol {

/// A cell whose corners are ranks, or numbers of vertices.
struct RankedCell {
  std::array<std::uint64_t, format::max_cell_corners> corners{};
  std::uint64_t point = 0;  // of a constant field
  format::CellSplit split = 0;
  int sign = 0;  // SpooledCell::sign
};

/// Cells of one shape, as they go into a chunk.
struct SortedCells {
  format::CellChunk chunk;
  std::vector<std::int8_t> signs;  // [cell]: SpooledCell::sign

  void clear() {
    chunk.clear();
    signs.clear();
  }
  /// Adds some of other cells: those of numbers from `begin` to `end`.
  void add(const SortedCells& others, std::size_t begin, std::size_t end);
  void add(const SortedCells& others) { add(others, 0, others.signs.size()); }

  /// Whether a chunk may have one more.
  [[nodiscard]] bool has_room() const {
    return chunk.size() < format::max_chunk_cells &&
           (chunk.shape != format::CellShape::polyhedron ||
            chunk.corners.size() + format::max_polyhedron_corners <= format::max_chunk_corners);
  }
};

/// Sorts cells by their point, if the field is constant, and their corners in ascending order; polyhedra by their point
/// or their lowest corner only. Equal ones are in an order that does not depend on the input's.
class CellSort {
 public:
  /// `rank_end`: all ranks are below it.
  [[nodiscard]] static Result<CellSort> create(format::CellShape shape, format::CellField field, std::uint64_t rank_end,
                                               std::uint64_t memory, const std::string& folder);

  /// A cell in the fewest bytes: a word for each corner, and one for the point of a constant field. Polyhedra have
  /// other records: append_records().
  using Record = std::array<std::uint64_t, format::max_cell_corners + 1>;
  [[nodiscard]] static std::size_t words_of(format::CellShape shape, format::CellField field) {
    if (shape == format::CellShape::polyhedron) return polyhedron_record_words;
    return format::corners_of(shape) + (field == format::CellField::constant ? 1 : 0);
  }
  [[nodiscard]] static Record record_of(format::CellShape shape, const RankedCell& cell);

  /// Adds records, words_of() of each, one after the other, and whole cells.
  [[nodiscard]] Status add(std::span<const std::uint64_t> records);

  /// Ends the adding. Call it once.
  [[nodiscard]] Status finish() { return sorter_.finish(); }

  /// Returns the rank that says where the next cell belongs: of its lowest corner, or of its point. None after the last
  /// cell. Requires finish().
  [[nodiscard]] Result<std::optional<std::uint64_t>> next_rank();

  /// Moves the next cells whose next_rank() is below `rank_end` to `cells`, at most `most`, while it has room: those
  /// that are in memory. Requires that next_rank() returned such a rank.
  void take(std::uint64_t rank_end, std::size_t most, SortedCells& cells);

  [[nodiscard]] format::CellShape shape() const { return shape_; }
  [[nodiscard]] format::CellField field() const { return field_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  CellSort(format::CellShape shape, format::CellField field, int rank_bits, ExternalSorter sorter)
      : shape_(shape),
        field_(field),
        rank_bits_(rank_bits),
        words_(words_of(shape, field)),
        sorter_(std::move(sorter)) {}
  [[nodiscard]] Status read();
  [[nodiscard]] std::uint64_t rank_at(std::size_t number) const;
  [[nodiscard]] bool are_polyhedra() const { return shape_ == format::CellShape::polyhedron; }
  [[nodiscard]] bool is_one_run(std::size_t first, std::size_t second) const;
  void order_runs();
  void order_run(std::size_t begin, std::size_t end);
  void order_polyhedra(std::size_t begin, std::size_t end);
  void add_to(SortedCells& cells, std::span<const std::uint64_t> record) const;
  void add_polyhedron_to(SortedCells& cells, std::span<const std::uint64_t> records);
  [[nodiscard]] std::span<std::uint64_t> record(std::size_t number) {
    return std::span(records_).subspan(number * words_, words_);
  }

  format::CellShape shape_;
  format::CellField field_;
  int rank_bits_;      // of the largest rank
  std::size_t words_;  // of a record
  ExternalSorter sorter_;
  std::uint64_t count_ = 0;
  std::vector<std::uint64_t> records_;  // whole runs of records that the sort does not tell apart, then part of one
  std::vector<MortonKey> keys_;         // of these
  std::size_t whole_ = 0;               // records of whole runs
  std::size_t next_ = 0;                // one of them
  bool ended_ = false;
  Polyhedron polyhedron_;
};

}  // namespace splatvol
