// The cells of a file, as a view shows them.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "base/part_table.h"
#include "format/cell_reader.h"
#include "format/volume.h"
#include "renderer/cell_source.h"
#include "sampler/cell_tetrahedra.h"
#include "scene/scene.h"
#include "streamer/cells/point_gradients.h"

namespace splatvol {

/// Which values of cells a scene shows.
struct ShownInCells {
  explicit ShownInCells(const Scene& scene);
  ShownInCells() = default;

  TransferFunction function = {};
  std::optional<SceneOpacity> opacity = {};
  std::vector<double> contours = {};  // in ascending order

  [[nodiscard]] bool has_contour(double low, double high) const;
  [[nodiscard]] bool operator==(const ShownInCells&) const = default;
};

/// The faces of a chunk's cells with a visible value: about.
struct ShownFaces {
  double share = 1;        // of the areas of all faces in the chunk
  dmat3 normals{1.0 / 3};  // [i][j]: the mean of n_i n_j for their normals n, by areas
};

/// The cells that a file keeps, with the values of a scene's attributes. Thread-safe.
class KeptCells {
 public:
  /// Of a series, the cells have the values of the volume's step. `room`: of the file. The volume must outlive the
  /// cells. Fails if the file keeps none.
  [[nodiscard]] static Result<std::shared_ptr<const KeptCells>> open(const format::Volume& volume, const Scene& scene,
                                                                     const PartRoom& room);
  KeptCells(const KeptCells&) = delete;
  KeptCells& operator=(const KeptCells&) = delete;

  [[nodiscard]] const format::CellReader& reader() const { return cells_->reader(); }
  [[nodiscard]] std::uint64_t unknown_cells() const { return cells_->unknown_cells(); }

  /// The cells, with summaries of the attribute and of the opacity's.
  [[nodiscard]] const CellTetrahedra& cells() const { return *cells_; }

  [[nodiscard]] const MemoryShare& share() const { return *room_.share; }

  /// The attribute that colours contours; empty: none.
  [[nodiscard]] const std::string& color_attribute() const { return color_name_; }

  /// As CellSource::read.
  [[nodiscard]] Result<const Tetrahedra*> read(const format::CellChunkEntry& entry, Tetrahedra& scratch) const;

  /// As CellSource::gradients.
  [[nodiscard]] Result<std::shared_ptr<const std::vector<dvec3>>> gradients(const format::CellChunkEntry& entry,
                                                                            const Tetrahedra& cells,
                                                                            std::span<const double> contours) const {
    // Where nothing is read, all of them are there for other contours, too.
    return are_held_ ? gradients_.at_all(entry, cells) : gradients_.at_contours(entry, cells, contours);
  }

  /// Reads a chunk, and remembers its faces for the last `shown`.
  [[nodiscard]] Result<ShownFaces> shown_faces(const format::CellChunkEntry& entry, const ShownInCells& shown) const;

  /// Reads all cells, unless memory lacks the room for them.
  [[nodiscard]] Status hold_all() const;
  [[nodiscard]] bool may_hold_all() const { return holds_all_; }

  /// Whether a chunk is held.
  [[nodiscard]] bool holds(const format::CellChunkEntry& entry) const;

  /// Whether all are held: nothing will be read.
  [[nodiscard]] bool are_held() const { return are_held_; }

  /// As CellTetrahedra::read_ahead, without what is held.
  [[nodiscard]] Result<format::CellsAhead> read_ahead(std::span<const format::CellChunkEntry> entries) const;

  /// The same for gradients at contours in chunks that have been read ahead: of other chunks.
  [[nodiscard]] Result<format::CellsAhead> read_gradients_ahead(std::span<const format::CellChunkEntry> entries,
                                                                std::span<const double> contours) const;

 private:
  KeptCells(std::unique_ptr<const CellTetrahedra> cells, std::string color_name, const PartRoom& room);
  [[nodiscard]] Result<Tetrahedra> decode(const format::CellChunkEntry& entry) const;
  [[nodiscard]] PartKey key_of(const format::CellChunkEntry& entry) const;

  std::unique_ptr<const CellTetrahedra> cells_;  // with the values, those of the opacity and those of colours
  std::string color_name_;
  PartRoom room_;
  bool holds_all_;  // the share has room for all cells, decoded
  PointGradients gradients_;
  mutable std::atomic<bool> are_held_ = false;

  // If it holds all: the chunks that were read, and all pages once they were. They stay.
  mutable std::mutex held_mutex_;
  mutable std::unordered_map<std::uint64_t, std::shared_ptr<const Tetrahedra>> chunks_;  // [CellChunkEntry::offset]
  mutable std::vector<std::shared_ptr<const format::CellPage>> pages_;

  mutable std::mutex faces_mutex_;
  mutable ShownInCells faces_of_;
  mutable std::unordered_map<std::uint64_t, ShownFaces> faces_;  // [CellChunkEntry::offset]
};

/// Chunks of cells that may be in a view and have a visible value, a contour or a slice. Others are not read.
class FileCells final : public CellSource {
 public:
  /// Reads the entries of chunks. `scene`: its functions and contours count, and nothing else.
  [[nodiscard]] static Result<std::unique_ptr<const FileCells>> open(std::shared_ptr<const KeptCells> kept,
                                                                     const Scene& scene, const View& view);

  [[nodiscard]] std::span<const Chunk> chunks() const override { return chunks_; }
  [[nodiscard]] Result<const Tetrahedra*> read(const Chunk& chunk, Tetrahedra& scratch) const override {
    return kept_->read(entries_[static_cast<std::size_t>(chunk.number)], scratch);
  }
  [[nodiscard]] Result<std::shared_ptr<const std::vector<dvec3>>> gradients(
      const Chunk& chunk, const Tetrahedra& cells, std::span<const double> contours) const override {
    return kept_->gradients(entries_[static_cast<std::size_t>(chunk.number)], cells, contours);
  }
  [[nodiscard]] Result<std::shared_ptr<const void>> read_ahead(std::span<const std::uint64_t> numbers) const override;

  /// Cells of shapes and fields that this program does not know. They are left out.
  [[nodiscard]] std::uint64_t unknown_cells() const { return kept_->unknown_cells(); }

  /// Tetrahedra of the chunks; about.
  [[nodiscard]] std::uint64_t tetrahedra() const;

  /// Those of chunks that are not held.
  [[nodiscard]] std::uint64_t unread_tetrahedra() const;

  /// Estimates the pieces of rays in a tetrahedron with a visible value: as if each chunk filled its box evenly. Reads
  /// some of the chunks.
  [[nodiscard]] Result<double> estimate_segments() const;

 private:
  FileCells(std::shared_ptr<const KeptCells> kept, const Scene& scene, const View& view)
      : kept_(std::move(kept)), shown_(scene), view_(view) {}
  [[nodiscard]] Status read_entries();
  // Estimated, if a chunk shows these faces.
  [[nodiscard]] double segments_of(const Chunk& chunk, const ShownFaces& faces) const;
  [[nodiscard]] bool may_meet_event(const Box& box, const format::ValueSummary& values) const;

  std::shared_ptr<const KeptCells> kept_;
  ShownInCells shown_;
  View view_;
  std::vector<Chunk> chunks_;
  std::vector<format::CellChunkEntry> entries_;  // [Chunk::number]
};

}  // namespace splatvol
