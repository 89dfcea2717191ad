// The cells of a small volume, and their section, made in the slow and obvious way.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "format/cells.h"
#include "format/volume_writer.h"

namespace splatvol::test {

struct TestVolume;

/// Cells of the points of a volume: tetrahedra, then polyhedra.
struct TestCells {
  std::vector<std::array<std::uint64_t, 4>> corners;  // ranks, ascending; in ascending order
  std::vector<std::uint8_t> segments;                 // [rank]
  format::CellChunk polyhedra{format::CellShape::polyhedron, format::CellField::corners, {}, {}, {}};
  std::size_t chunk_cells = 16;  // most of a chunk
  std::size_t page_chunks = 4;   // most of a page
  std::uint64_t turned = 0;      // as the section states
};

/// Adds cells of the same shape and field: those of `others` from `begin` to `end`.
void append_cells(format::CellChunk& cells, const format::CellChunk& others, std::size_t begin, std::size_t end);

/// Returns a chunk with another payload, and a count of cells to go with it. Its hash is right.
[[nodiscard]] format::PackedCells repacked(format::PackedCells cells, const format::Bytes& payload,
                                           std::uint32_t count);

/// Returns the rank of each point: [point], file order.
[[nodiscard]] std::vector<std::uint64_t> ranks_of(const TestVolume& volume);

/// Gives the volume cells. `tetrahedra`: points, in file order.
void add_cells(TestVolume& volume, const std::vector<std::array<std::uint32_t, 4>>& tetrahedra);

/// Gives the volume `count` cells between points whose ranks are near each other.
void add_random_cells(TestVolume& volume, std::size_t count, std::uint32_t seed = 1);

/// A surface of so many corners, in any order: it is closed, and has no shape.
[[nodiscard]] std::vector<format::SurfaceTriangle> random_surface(std::size_t corners, std::mt19937& random);

/// Gives the cells of a volume `count` polyhedra besides, as add_random_cells().
void add_random_polyhedra(TestVolume& volume, std::size_t count, std::uint32_t seed = 1);

/// Writes the section (format::WriteCells).
[[nodiscard]] Status write_test_cells(const TestCells& cells, std::shared_ptr<const format::ChunkSource> chunks,
                                      const format::AppendBytes& append);

}  // namespace splatvol::test
