// Cells of a mesh, as the processor draws them exactly: it pulls them chunk by chunk while it draws.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

/// Tetrahedra whose values are linear, or constant, in each.
struct DrawnCells {
  std::vector<dvec3> points;           // world coordinates
  std::vector<double> values;          // [point], or [tetrahedron] if constant; NaN: missing
  std::vector<double> opacity_values;  // as values, of the scene's opacity; empty: none
  std::vector<double> color_values;    // as values, of the attribute that colours contours; empty: none
  bool constant = false;

  /// [tetrahedron]: points in ascending order of numbers. The same points of two chunks have numbers in the same order.
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return points.capacity() * sizeof(dvec3) +
           (values.capacity() + opacity_values.capacity() + color_values.capacity()) * sizeof(double) +
           tetrahedra.capacity() * sizeof(tetrahedra[0]);
  }
};

/// Cells in chunks.
class CellSource {
 public:
  struct Chunk {
    Box box;                   // round the points
    std::uint32_t tetrahedra;  // about
    std::uint64_t number;      // in the source
  };

  virtual ~CellSource() = default;

  /// The chunks that may show something, in any order. Each cell is in one.
  [[nodiscard]] virtual std::span<const Chunk> chunks() const = 0;

  /// Called before chunks are read, by their numbers: a source far away can then read what all of them need at once.
  /// The result is kept until they are read.
  [[nodiscard]] virtual Result<std::shared_ptr<const void>> read_ahead(
      std::span<const std::uint64_t> /*numbers*/) const {
    return nullptr;
  }

  /// Reads a chunk: into `scratch`, whose memory it keeps, unless it holds the cells itself. Returns where they are
  /// until the next call with this scratch. Thread-safe.
  [[nodiscard]] virtual Result<const DrawnCells*> read(const Chunk& chunk, DrawnCells& scratch) const = 0;
};

}  // namespace splatvol
