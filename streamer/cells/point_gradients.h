// The gradients of a value at the points of a file's cells.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/part_table.h"
#include "base/point_gradients.h"
#include "format/cell_reader.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {

/// Finds the gradient of the first attribute at points (base/point_gradients.h): of all tetrahedra at a point, whatever
/// chunks they are in. Points are one by their rank: those of bodies that a file keeps apart do not mix. Results do not
/// depend on memory, threads and the order of calls. They are held as parts of the file. Thread-safe.
class PointGradients {
 public:
  using Gradients = std::shared_ptr<const std::vector<dvec3>>;  // [point of a chunk]

  /// As CellSource::read; tetrahedra need their ranks.
  using ReadChunk = std::function<Result<const Tetrahedra*>(const format::CellChunkEntry&, Tetrahedra&)>;

  /// `cells` and what `read` uses must outlive this.
  PointGradients(const CellTetrahedra& cells, const PartRoom& room, ReadChunk read)
      : cells_(cells), room_(room), read_(std::move(read)) {}

  /// Returns the gradients at all points of a chunk. `cells`: its own, with values at points. Reads the chunks with a
  /// box that meets its own.
  [[nodiscard]] Result<Gradients> at_all(const format::CellChunkEntry& entry, const Tetrahedra& cells) const;

  /// Returns those at the points of tetrahedra that a contour cuts; others have any. `contours`: values, ascending.
  /// Reads the chunks with one of these points in their boxes: few that have no contour themselves.
  [[nodiscard]] Result<Gradients> at_contours(const format::CellChunkEntry& entry, const Tetrahedra& cells,
                                              std::span<const double> contours) const;

  /// Returns the chunks that at_contours() would read, besides its own.
  [[nodiscard]] Result<std::vector<format::CellChunkEntry>> sources_at_contours(const format::CellChunkEntry& entry,
                                                                                const Tetrahedra& cells,
                                                                                std::span<const double> contours) const;

 private:
  using Points = std::vector<std::uint8_t>;  // [point of a chunk]: whether it is meant

  // Those of some points.
  struct Known {
    Points points;
    std::vector<dvec3> gradients;
  };

  [[nodiscard]] PartKey key_of(const format::CellChunkEntry& entry, std::uint64_t hash) const;
  [[nodiscard]] Result<std::vector<format::CellChunkEntry>> sources_of(const format::CellChunkEntry& entry,
                                                                       const Tetrahedra& cells,
                                                                       const Points& points) const;
  [[nodiscard]] Result<std::vector<dvec3>> find(const format::CellChunkEntry& entry, const Tetrahedra& cells,
                                                const Points& points) const;

  const CellTetrahedra& cells_;
  PartRoom room_;
  ReadChunk read_;
};

}  // namespace splatvol
