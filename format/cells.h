// The cells of a mesh to and from bytes (spec/svol-1.md, section 14).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/cell_shapes.h"
#include "format/codec.h"
#include "format/columns.h"
#include "format/layout.h"

namespace splatvol::format {

/// Cells of one shape and field.
struct CellChunk {
  CellShape shape = CellShape::tetrahedron;
  CellField field = CellField::corners;
  std::vector<std::uint64_t> corners;  // [cell][corner]: ranks; numbers of vertices if the field is constant
  std::vector<CellSplit> splits;       // [cell]; empty: tetrahedra
  std::vector<std::uint64_t> points;   // [cell]: the rank of the point whose value it has, if the field is constant

  [[nodiscard]] std::size_t size() const { return corners.size() / corners_of(shape); }
  [[nodiscard]] std::span<const std::uint64_t> corners_at(std::size_t cell) const {
    return std::span(corners).subspan(cell * corners_of(shape), corners_of(shape));
  }
  [[nodiscard]] CellSplit split_at(std::size_t cell) const { return splits.empty() ? CellSplit{0} : splits[cell]; }
};

/// The names of a shape and of a field; "shape 77", "field 77" if this program does not know them.
[[nodiscard]] std::string cell_shape_name(CellShape shape);
[[nodiscard]] std::string cell_field_name(CellField field);

/// Cells whose corners are numbered for themselves.
struct LocalCells {
  std::vector<std::uint64_t> ranks;    // different ones, ascending
  std::vector<std::uint32_t> corners;  // [cell][corner]: index into ranks
};

/// Numbers the corners of cells, [cell][corner]: ranks.
[[nodiscard]] LocalCells number_corners(std::span<const std::uint64_t> corners);

/// What cells fill.
struct CellExtent {
  Box box;          // round the corners
  double area = 0;  // of the faces of all tetrahedra of the cells: a face between two counts twice
};

/// Calls visit(tetrahedron) for the tetrahedra of all cells, as indices into the ranks of `local`.
template <class Visit>
void for_each_tetrahedron(const CellChunk& cells, const LocalCells& local, const Visit& visit) {
  const std::uint32_t* corners = local.corners.data();
  if (cells.shape == CellShape::tetrahedron) {
    for (const std::uint32_t* end = corners + local.corners.size(); corners != end; corners += 4)
      visit(std::array{corners[0], corners[1], corners[2], corners[3]});
    return;
  }
  const std::size_t count = corners_of(cells.shape);
  for (std::size_t cell = 0; cell < cells.size(); ++cell, corners += count) {
    for (const auto& [a, b, c, d] : tetrahedra_of(cells.shape, cells.split_at(cell)))
      visit(std::array{corners[a], corners[b], corners[c], corners[d]});
  }
}

/// Measures cells by the positions of their corners. `positions`: [index into LocalCells::ranks].
[[nodiscard]] CellExtent measure_cells(const CellChunk& cells, const LocalCells& local,
                                       std::span<const dvec3> positions);

/// Returns the range of the values in the cells, and their bins: also those of values between two corners. A
/// tetrahedron with a missing value at a corner has none. `values`: stored, [index into LocalCells::ranks].
[[nodiscard]] ValueSummary summarize_cells(const CellChunk& cells, const LocalCells& local,
                                           std::span<const float> values, const ValueBins& bins);

/// A chunk of cells ready to be written. Of the entry, hash, lengths, counts, shape and field are set.
struct PackedCells {
  CellChunkEntry entry{};
  Bytes bytes;
};

/// Packs 1 to max_chunk_cells cells that are known. `points`: how many different ones they name. Requires different
/// corners in each cell, and the ascending order of the lowest corners of all cells; of their points if the field is
/// constant.
[[nodiscard]] PackedCells pack_cells(const CellChunk& cells, std::size_t points);

/// The most bytes that a chunk of a known shape and field has unpacked.
[[nodiscard]] std::uint64_t most_unpacked_bytes(const CellChunkEntry& entry);

/// Undoes pack_cells. The corners of a cell may come in another order, which is the same cell turned or mirrored. They
/// are different. Ranks are below `points`, and numbers of vertices below `vertices`. Requires a known shape and field,
/// and an entry that CellReader::read_page returned. Safe on untrusted `packed`.
[[nodiscard]] Result<CellChunk> unpack_cells(const CellChunkEntry& entry, std::span<const std::byte> packed,
                                             std::uint64_t points, std::uint64_t vertices, std::string_view what);

/// Where the points of consecutive ranks are in the file.
struct RankPage {
  std::uint64_t first = 0;             // rank
  std::vector<std::uint64_t> before;   // [segment]: points of lower ranks
  std::vector<std::uint8_t> segments;  // [rank - first]
};

/// The page before packing, and packed.
[[nodiscard]] Bytes pack_rank_page(const RankPage& page, PackedPageRef& ref);

/// Undoes pack_rank_page. `counts`: points of each segment; `ranks`: of the page. Safe on untrusted `packed`.
[[nodiscard]] Result<RankPage> unpack_rank_page(const PackedPageRef& ref, std::span<const std::byte> packed,
                                                std::uint64_t first, std::size_t ranks,
                                                std::span<const std::uint64_t> counts, std::string_view what);

}  // namespace splatvol::format
