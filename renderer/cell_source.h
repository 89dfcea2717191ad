// Cells of a mesh, as the processor draws them exactly: it pulls them chunk by chunk while it draws.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/tetrahedra.h"

namespace splatvol {

/// Cells in chunks. Their values: of the scene's attribute, then of its opacity's if it has one, and last of the one
/// that colours contours if there is one.
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
  [[nodiscard]] virtual Result<const Tetrahedra*> read(const Chunk& chunk, Tetrahedra& scratch) const = 0;

  /// Returns the gradients of the scene's attribute at the points of a chunk, in world coordinates: means over all
  /// tetrahedra at a point, the same in all chunks with the point; 0: none. Points of no tetrahedron that a contour
  /// cuts have any. `cells`: of the chunk, with values at points. `contours`: values, ascending. Thread-safe.
  [[nodiscard]] virtual Result<std::shared_ptr<const std::vector<dvec3>>> gradients(
      const Chunk& chunk, const Tetrahedra& cells, std::span<const double> contours) const = 0;
};

}  // namespace splatvol
