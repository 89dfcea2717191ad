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
#include "format/polyhedron.h"

namespace splatvol::format {

/// Cells of one shape and field.
struct CellChunk {
  CellShape shape = CellShape::tetrahedron;
  CellField field = CellField::corners;
  std::vector<std::uint64_t> corners;  // [cell][corner]: ranks; numbers of vertices if the field is constant
  std::vector<CellSplit> splits;       // [cell]; empty: tetrahedra
  std::vector<std::uint64_t> points;   // [cell]: the rank of the point whose value it has, if the field is constant

  // Of polyhedra, whose corners ascend.
  std::vector<std::uint32_t> ends = {};         // [cell]: of its corners
  std::vector<SurfaceTriangle> triangles = {};  // [cell][triangle]: its surface, as indices of its corners

  [[nodiscard]] std::size_t size() const {
    return shape == CellShape::polyhedron ? ends.size() : corners.size() / corners_of(shape);
  }
  /// The index of a cell's first corner; that of all corners' end for a cell of number size().
  [[nodiscard]] std::size_t begin_of(std::size_t cell) const {
    if (shape != CellShape::polyhedron) return cell * corners_of(shape);
    return cell == 0 ? 0 : ends[cell - 1];
  }
  [[nodiscard]] std::span<const std::uint64_t> corners_at(std::size_t cell) const {
    return std::span(corners).subspan(begin_of(cell), begin_of(cell + 1) - begin_of(cell));
  }
  /// Requires polyhedra.
  [[nodiscard]] std::span<const SurfaceTriangle> triangles_at(std::size_t cell) const {
    const std::size_t begin = 2 * begin_of(cell) - 4 * cell, end = 2 * begin_of(cell + 1) - 4 * (cell + 1);
    return std::span(triangles).subspan(begin, end - begin);
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

/// Calls visit(tetrahedron) for the tetrahedra of a cell, as indices of its corners.
template <class Visit>
void for_each_tetrahedron(const CellChunk& cells, std::size_t cell, const Visit& visit) {
  if (cells.shape == CellShape::polyhedron)
    return for_each_tetrahedron(cells.triangles_at(cell), cells.splits[cell], visit);
  for (const std::array<std::uint8_t, 4>& corners : tetrahedra_of(cells.shape, cells.split_at(cell))) visit(corners);
}

/// Calls visit(tetrahedron) for the tetrahedra of all cells, as indices into the ranks of `local`.
template <class Visit>
void for_each_tetrahedron(const CellChunk& cells, const LocalCells& local, const Visit& visit) {
  const std::uint32_t* corners = local.corners.data();
  if (cells.shape == CellShape::tetrahedron) {
    for (const std::uint32_t* end = corners + local.corners.size(); corners != end; corners += 4)
      visit(std::array{corners[0], corners[1], corners[2], corners[3]});
    return;
  }
  for (std::size_t cell = 0; cell < cells.size(); ++cell) {
    const std::uint32_t* const of_cell = corners + cells.begin_of(cell);
    for_each_tetrahedron(cells, cell, [&](const std::array<std::uint8_t, 4>& at) {
      visit(std::array{of_cell[at[0]], of_cell[at[1]], of_cell[at[2]], of_cell[at[3]]});
    });
  }
}

/// Measures cells by the positions of their corners. `positions`: [index into LocalCells::ranks].
[[nodiscard]] CellExtent measure_cells(const CellChunk& cells, const LocalCells& local,
                                       std::span<const dvec3> positions);

/// Returns the range of the values in the cells, and their bins: also those of values between two corners. A
/// tetrahedron with a missing value at a corner has none. `values`: stored, [index into LocalCells::ranks].
[[nodiscard]] ValueSummary summarize_cells(const CellChunk& cells, const LocalCells& local,
                                           std::span<const float> values, const ValueBins& bins);

/// A chunk of cells ready to be written. Only the hash, lengths, counts, shape and field of the entry
/// are set.
struct PackedCells {
  CellChunkEntry entry{};
  Bytes bytes;
};

/// Packs 1 to max_chunk_cells cells that are known, with at most max_chunk_corners. `points`: how many different ones
/// they name. Requires ascending, different corners in each cell, surfaces that encode_surface() takes, and the
/// ascending order of the lowest corners of all cells; of their points if the field is constant. `permutations`:
/// [cell]: the order of corners that its split is for; none: tetrahedra or polyhedra.
[[nodiscard]] PackedCells pack_cells(const CellChunk& cells, std::size_t points,
                                     std::span<const Permutation> permutations = {});

/// The most corners that the cells of a chunk of a known shape have, one by one.
[[nodiscard]] std::uint64_t most_corners(const CellChunkEntry& entry);

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
