// The cells of a file, as a view shows them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "format/cell_reader.h"
#include "format/volume.h"
#include "player/cell_points.h"
#include "renderer/cell_source.h"
#include "scene/scene.h"

namespace splatvol {

/// Chunks of cells that may be in a view and have a visible value. Others are not read.
class FileCells final : public CellSource {
 public:
  /// Reads the entries of chunks. Of a series, the cells have the values of the volume's step. `scene`: its attributes
  /// and functions count, and nothing else. `memory`: bytes to hold, besides the entries and one chunk for each thread.
  /// The volume must outlive the cells. Fails if the file keeps none.
  [[nodiscard]] static Result<std::unique_ptr<const FileCells>> open(const format::Volume& volume, const Scene& scene,
                                                                     const View& view, std::uint64_t memory);

  [[nodiscard]] std::span<const Chunk> chunks() const override { return chunks_; }
  [[nodiscard]] Result<const DrawnCells*> read(const Chunk& chunk, DrawnCells& scratch) const override;

  /// Cells of shapes and fields that this program does not know. They are left out.
  [[nodiscard]] std::uint64_t unknown_cells() const { return unknown_cells_; }

  /// Estimates the pieces of rays in a tetrahedron of the chunks: as if each chunk filled its box evenly, with faces in
  /// all directions.
  [[nodiscard]] double estimate_segments() const;

 private:
  FileCells(const format::Volume& volume, const View& view) : volume_(volume), view_(view) {}
  [[nodiscard]] Status read_entries(const Scene& scene, const format::SummaryAttributes& attributes);
  [[nodiscard]] Status read_constant(const format::CellChunk& kept, const format::LocalCells& local,
                                     DrawnCells& cells) const;

  const format::Volume& volume_;
  View view_;
  std::unique_ptr<const format::CellReader> reader_;
  std::unique_ptr<const CellPoints> points_;
  std::vector<Chunk> chunks_;
  std::vector<format::CellChunkEntry> entries_;  // [Chunk::number]
  std::uint64_t unknown_cells_ = 0;
};

}  // namespace splatvol
