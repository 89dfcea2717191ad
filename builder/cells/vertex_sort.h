// Corners of cells that are no points of the file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/temp_file.h"
#include "builder/cells/tag_sort.h"
#include "builder/sorting/record_spool.h"
#include "builder/sources/source.h"
#include "format/codec.h"
#include "format/layout.h"

namespace splatvol {

/// Numbers the corners of cells of their own in Morton order, those at one position once, and packs their positions.
class VertexSort {
 public:
  /// `memory`: bytes to hold. `exact`: whether positions are stored as they are given.
  VertexSort(std::uint64_t memory, std::string folder, bool exact);

  /// Adds the corners of a piece that cells with a point have. Requires piece.cells.
  [[nodiscard]] Status add(std::uint32_t piece_number, const Piece& piece);

  /// Numbers them. Called once, after the last piece.
  [[nodiscard]] Status sort();

  /// Replaces `numbers` by those of a piece's corners; TagSort::none: no cell has it. Requires ascending pieces.
  [[nodiscard]] Status load(std::uint32_t piece, std::uint32_t corners, std::vector<std::uint64_t>& numbers) {
    return tags_->load(piece, corners, numbers);
  }

  /// The number of vertices, and their pages. Require sort().
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] const std::vector<format::PackedPageRef>& pages() const { return pages_; }
  [[nodiscard]] Result<format::Bytes> read_packed(std::size_t page) const;

  /// Returns the positions of a page as they are stored. `cube`: of the file. Thread-safe.
  [[nodiscard]] Result<std::vector<dvec3>> read(std::size_t page, const Cube& cube) const;

 private:
  [[nodiscard]] Status number_vertices(const Cube& cube);
  [[nodiscard]] Status close_page(std::vector<dvec3>& vertices, double height);

  std::uint64_t memory_;
  std::string folder_;
  bool exact_;
  Box box_;
  RecordSpool spool_;
  std::optional<TagSort> tags_;
  std::optional<TempFile> file_;
  std::vector<format::PackedPageRef> pages_;  // offsets in file_
  std::uint64_t count_ = 0;
};

}  // namespace splatvol
