// Cells of one shape in the order of their corners, out of memory.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sorting/external_sort.h"
#include "format/cells.h"

namespace splatvol {

/// A cell whose corners are ranks.
struct RankedCell {
  std::array<std::uint64_t, format::max_cell_corners> corners{};
  format::CellSplit split = 0;
  int sign = 0;  // SpooledCell::sign
};

/// Cells of one shape, as they go into a chunk.
struct SortedCells {
  format::CellChunk chunk;
  std::vector<std::int8_t> signs;  // [cell]: SpooledCell::sign

  void clear() {
    chunk.corners.clear();
    chunk.splits.clear();
    signs.clear();
  }
  void add(const RankedCell& cell);
  void add(const SortedCells& others);
};

/// Sorts cells by their corners in ascending order. Equal ones are in an order that does not depend on the input's.
class CellSort {
 public:
  [[nodiscard]] static Result<CellSort> create(format::CellShape shape, std::uint64_t memory,
                                               const std::string& folder);

  /// A cell in the fewest bytes: as many words as corners.
  using Record = std::array<std::uint64_t, format::max_cell_corners>;
  [[nodiscard]] static Record record_of(format::CellShape shape, const RankedCell& cell);

  /// Adds records, as many words of each as there are corners, one after the other.
  [[nodiscard]] Status add(std::span<const std::uint64_t> records);

  /// Ends the adding. Call it once.
  [[nodiscard]] Status finish() { return sorter_.finish(); }

  /// Returns the lowest corner of the next cell, none after the last. Requires finish().
  [[nodiscard]] Result<std::optional<std::uint64_t>> next_corner();

  /// Takes the next cell. Requires that next_corner() returned one.
  [[nodiscard]] RankedCell take();

  [[nodiscard]] format::CellShape shape() const { return shape_; }
  [[nodiscard]] std::uint64_t count() const { return sorter_.count(); }

 private:
  CellSort(format::CellShape shape, ExternalSorter sorter)
      : shape_(shape), words_(format::corners_of(shape)), sorter_(std::move(sorter)) {}
  [[nodiscard]] Status read();
  void order_runs();
  [[nodiscard]] std::span<std::uint64_t> record(std::size_t number) {
    return std::span(ready_).subspan(number * words_, words_);
  }

  format::CellShape shape_;
  std::size_t words_;  // of a record
  ExternalSorter sorter_;
  std::vector<std::uint64_t> ready_;   // whole runs of records that the sort does not tell apart
  std::vector<std::uint64_t> behind_;  // the beginning of a run
  std::size_t next_ = 0;               // record of ready_
  bool ended_ = false;
};

}  // namespace splatvol
