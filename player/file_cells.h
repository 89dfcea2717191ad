// The cells of a file, as a view shows them.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "format/cell_reader.h"
#include "format/volume.h"
#include "player/cell_points.h"
#include "player/held_parts.h"
#include "renderer/cell_source.h"
#include "scene/scene.h"

namespace splatvol {

/// The cells that a file keeps, with the values of a scene's attributes. Holds what was read last, for the next
/// picture. Thread-safe.
class KeptCells {
 public:
  /// Of a series, the cells have the values of the volume's step. `memory`: bytes to hold. The volume must outlive the
  /// cells. Fails if the file keeps none.
  [[nodiscard]] static Result<std::shared_ptr<const KeptCells>> open(const format::Volume& volume, const Scene& scene,
                                                                     std::uint64_t memory);

  [[nodiscard]] const format::CellReader& reader() const { return *reader_; }
  [[nodiscard]] const format::SummaryAttributes& attributes() const { return attributes_; }

  /// The counts of values for each attribute, or none. Reads them once.
  [[nodiscard]] Result<std::span<const format::Histogram>> histograms() const;

  /// As CellSource::read.
  [[nodiscard]] Result<const DrawnCells*> read(const format::CellChunkEntry& entry, DrawnCells& scratch) const;

 private:
  KeptCells(std::unique_ptr<const format::CellReader> reader, const format::SummaryAttributes& attributes,
            std::uint64_t memory);
  [[nodiscard]] Status decode(const format::CellChunkEntry& entry, DrawnCells& cells) const;
  [[nodiscard]] Status decode_constant(const format::CellChunk& kept, const format::LocalCells& local,
                                       DrawnCells& cells) const;

  std::unique_ptr<const format::CellReader> reader_;
  format::SummaryAttributes attributes_;
  bool holds_all_;  // memory has room for all cells, decoded
  CellPoints points_;
  mutable HeldParts chunks_;  // all that were read, if it holds all
  mutable std::mutex mutex_;  // of the histograms
  mutable std::optional<std::vector<format::Histogram>> histograms_;
};

/// Chunks of cells that may be in a view and have a visible value. Others are not read.
class FileCells final : public CellSource {
 public:
  /// Reads the entries of chunks. `scene`: its functions count, and nothing else.
  [[nodiscard]] static Result<std::unique_ptr<const FileCells>> open(std::shared_ptr<const KeptCells> kept,
                                                                     const Scene& scene, const View& view);

  /// Whether open() would give the same again.
  [[nodiscard]] bool are_of(const std::shared_ptr<const KeptCells>& kept, const Scene& scene, const View& view) const {
    return kept_ == kept && function_ == scene.transfer_function && opacity_ == scene.opacity && view_ == view;
  }

  [[nodiscard]] std::span<const Chunk> chunks() const override { return chunks_; }
  [[nodiscard]] Result<const DrawnCells*> read(const Chunk& chunk, DrawnCells& scratch) const override {
    return kept_->read(entries_[chunk.number], scratch);
  }

  /// Cells of shapes and fields that this program does not know. They are left out.
  [[nodiscard]] std::uint64_t unknown_cells() const;

  /// Estimates the pieces of rays in a tetrahedron with a visible value: as if each chunk filled its box evenly, with
  /// faces in all directions.
  [[nodiscard]] Result<double> estimate_segments() const;

 private:
  FileCells(std::shared_ptr<const KeptCells> kept, const Scene& scene, const View& view)
      : kept_(std::move(kept)), function_(scene.transfer_function), opacity_(scene.opacity), view_(view) {}
  [[nodiscard]] Status read_entries();

  std::shared_ptr<const KeptCells> kept_;
  TransferFunction function_;
  std::optional<SceneOpacity> opacity_;
  View view_;
  std::vector<Chunk> chunks_;
  std::vector<format::CellChunkEntry> entries_;                 // [Chunk::number]
  std::vector<std::array<format::ValueSummary, 2>> summaries_;  // of these: the values, and the opacity's
};

}  // namespace splatvol
