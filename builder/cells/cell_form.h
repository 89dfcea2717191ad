// Cells as records of a sort.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/cells/polyhedra.h"
#include "format/cells.h"

namespace splatvol {

/// A part of a record.
using CellWord = std::uint32_t;

/// A cell whose corners are ranks, or numbers of vertices.
struct RankedCell {
  std::array<std::uint64_t, format::max_cell_corners> ranks{};  // of the corners, ascending
  std::uint64_t point = 0;                                      // of a constant field
  format::Permutation permutation = 0;                          // of the corners
  format::CellSplit split = 0;
  int sign = 0;  // SpooledCell::sign
};

/// Cells that were records.
struct RankedCells {
  format::CellChunk chunk;                        // the corners of each cell ascend
  std::vector<format::Permutation> permutations;  // [cell]; none: polyhedra
  std::vector<std::int8_t> signs;                 // [cell]: SpooledCell::sign
};

/// The form of the records of one shape and field: numbers side by side, each in the bits that the largest one needs.
/// They are the point of a constant field, the corners in ascending order, and a code of split, permutation and sign.
/// Records compare word by word as the cells do. A polyhedron has one or more records, which begin with its rank and
/// its hash.
class CellForm {
 public:
  /// `rank_end`: all ranks, and numbers of vertices, are below it.
  CellForm(format::CellShape shape, format::CellField field, std::uint64_t rank_end);

  [[nodiscard]] format::CellShape shape() const { return shape_; }
  [[nodiscard]] format::CellField field() const { return field_; }
  [[nodiscard]] bool is_of_polyhedra() const { return shape_ == format::CellShape::polyhedron; }
  [[nodiscard]] std::size_t words() const { return words_; }  // of a record

  /// Appends the record of a cell.
  void append(const RankedCell& cell, std::vector<CellWord>& records) const;

  /// Appends the records of a polyhedron whose corners are ranks, or numbers of vertices. Returns its hash, which
  /// depends neither on its sign nor on the order of its triangles. Requires a surface that a file can keep.
  std::uint64_t append(const Polyhedron& polyhedron, std::vector<CellWord>& records) const;

  /// The rank that says where a cell belongs: of its lowest corner, or of its point.
  [[nodiscard]] std::uint64_t rank_of(const CellWord* record) const {
    return (std::uint64_t{record[0]} << 32 | record[1]) >> (64 - rank_bits_);
  }

  /// The records of a cell, and its corners. Its first record tells both.
  [[nodiscard]] std::size_t records_of(const CellWord* record) const;
  [[nodiscard]] std::size_t corners_of(const CellWord* record) const;

  /// The place of a record among those of its cell.
  [[nodiscard]] std::size_t place_of(const CellWord* record) const {
    return is_of_polyhedra() ? record[3] >> 2 & 0xff : 0;
  }

  /// Whether two records are of one polyhedron, or of cells that the first words do not tell apart.
  [[nodiscard]] bool are_alike(const CellWord* a, const CellWord* b) const {
    return std::equal(a, a + 3, b) && (!is_of_polyhedra() || a[3] >> 10 == b[3] >> 10);
  }

  /// Takes cells out of all of their records.
  [[nodiscard]] RankedCells read(std::span<const CellWord> records) const;

 private:
  void read_polyhedra(std::span<const CellWord> records, RankedCells& cells) const;

  format::CellShape shape_;
  format::CellField field_;
  std::size_t corners_, words_;
  std::uint32_t permutations_ = 0;
  int rank_bits_, code_bits_ = 0;  // the code fills the last word
};

}  // namespace splatvol
