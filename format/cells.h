// The cells of a mesh to and from bytes (spec/svol-1.md, section 14).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/codec.h"
#include "format/columns.h"
#include "format/layout.h"

namespace splatvol::format {

/// Returns the number of corners; 0: a shape that this program does not know.
[[nodiscard]] constexpr std::size_t corners_of(CellShape shape) { return shape == CellShape::tetrahedron ? 4 : 0; }

/// Whether cells of this shape and field can be decoded.
[[nodiscard]] constexpr bool is_known(CellShape shape, CellField field) {
  return corners_of(shape) > 0 && field == CellField::corners;
}

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
  double area = 0;  // of the faces of all cells: a face between two cells counts twice
};

/// Measures cells by the positions of their corners. `positions`: [index into LocalCells::ranks].
[[nodiscard]] CellExtent measure_cells(CellShape shape, std::span<const std::uint32_t> corners,
                                       std::span<const dvec3> positions);

/// Returns the range of the values in the cells, and their bins: also those of values between two corners. A cell with
/// a missing value at a corner has none. `values`: stored, [index into LocalCells::ranks].
[[nodiscard]] ValueSummary summarize_cells(CellShape shape, std::span<const std::uint32_t> corners,
                                           std::span<const float> values, const ValueBins& bins);

/// A chunk of cells ready to be written. Of the entry, hash, lengths, counts, shape and field are set.
struct PackedCells {
  CellChunkEntry entry{};
  Bytes bytes;
};

/// Packs cells, [cell][corner]: ranks, ascending in a cell. Requires 1 to max_chunk_cells of them, in the ascending
/// order of the ranks of their first corners.
[[nodiscard]] PackedCells pack_cells(CellShape shape, CellField field, std::span<const std::uint64_t> corners,
                                     std::size_t points);

/// Undoes pack_cells. Ranks ascend in a cell and are below `points`. Requires a known shape and field, and an entry
/// that CellReader::read_page returned. Safe on untrusted `packed`.
[[nodiscard]] Result<std::vector<std::uint64_t>> unpack_cells(const CellChunkEntry& entry,
                                                              std::span<const std::byte> packed, std::uint64_t points,
                                                              std::string_view what);

/// Where the points of consecutive ranks are in the file.
struct RankPage {
  std::uint64_t first = 0;             // rank
  std::vector<std::uint64_t> before;   // [segment]: points of lower ranks
  std::vector<std::uint8_t> segments;  // [rank - first]
};

/// The page before packing, and packed.
[[nodiscard]] Bytes pack_rank_page(const RankPage& page, RankPageRef& ref);

/// Undoes pack_rank_page. `counts`: points of each segment; `ranks`: of the page. Safe on untrusted `packed`.
[[nodiscard]] Result<RankPage> unpack_rank_page(const RankPageRef& ref, std::span<const std::byte> packed,
                                                std::uint64_t first, std::size_t ranks,
                                                std::span<const std::uint64_t> counts, std::string_view what);

}  // namespace splatvol::format
