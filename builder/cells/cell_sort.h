// Cells of one shape in the order of their corners, out of memory.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/cells/cell_form.h"
#include "builder/sorting/external_sort.h"

namespace splatvol {

/// Cells that follow each other: whole records.
struct SortedCells {
  const CellForm* form = nullptr;
  std::vector<CellWord> records = {};
  std::size_t cells = 0, corners = 0;  // how many there are
};

/// Sorts cells by their point, if the field is constant, and their corners in ascending order; polyhedra by their point
/// or their lowest corner only. Equal ones are in an order that does not depend on the input's.
class CellSort {
 public:
  [[nodiscard]] static Result<CellSort> create(const CellForm& form, std::uint64_t memory, const std::string& folder);

  /// Adds whole cells (CellForm::append).
  [[nodiscard]] Status add(std::span<const CellWord> records);

  /// Ends the adding. Call it once.
  [[nodiscard]] Status finish() { return sorter_.finish(); }

  /// Returns the rank that says where the next cell belongs (CellForm::rank_of). None after the last cell. Requires
  /// finish().
  [[nodiscard]] Result<std::optional<std::uint64_t>> next_rank();

  /// Moves the next cells whose next_rank() is below `rank_end` to `cells`, while a chunk has room for one more: those
  /// that are in memory. Requires that next_rank() returned such a rank.
  void take(std::uint64_t rank_end, SortedCells& cells);

  /// Whether a chunk of `cells` may have one more.
  [[nodiscard]] bool has_room(const SortedCells& cells) const {
    return cells.cells < format::max_chunk_cells &&
           (!form_.is_of_polyhedra() || cells.corners + format::max_polyhedron_corners <= format::max_chunk_corners);
  }

  [[nodiscard]] const CellForm& form() const { return form_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  CellSort(const CellForm& form, ExternalSorter sorter) : form_(form), sorter_(std::move(sorter)) {}
  [[nodiscard]] Status read();
  void order_run(std::size_t begin, std::size_t end);
  [[nodiscard]] const CellWord* record(std::size_t number) const { return records_.data() + number * form_.words(); }

  CellForm form_;
  ExternalSorter sorter_;
  std::uint64_t count_ = 0;
  std::vector<CellWord> records_;  // whole runs of records that the sort does not tell apart, then part of one
  std::size_t whole_ = 0;          // records of whole runs
  std::size_t next_ = 0;           // one of them
  bool ended_ = false;
};

}  // namespace splatvol
