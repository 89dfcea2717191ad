// The tetrahedra of the cells that a file keeps, chunk by chunk.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <thread>
#include <vector>

#include "base/error.h"
#include "base/interruption.h"
#include "base/part_table.h"
#include "base/run_tasks.h"
#include "base/tetrahedra.h"
#include "format/cell_reader.h"
#include "format/cells_ahead.h"
#include "format/part_kinds.h"
#include "format/ranked_points.h"
#include "format/volume.h"

namespace splatvol {

/// The failure of what needs cells and finds none.
[[nodiscard]] tl::unexpected<Error> fail_without_cells(const format::Volume& volume);

/// The box of a chunk of cells, or of a page of them, as positions are stored.
template <class Entry>
[[nodiscard]] Box box_of_cells(const Entry& entry) {
  return {{entry.low[0], entry.low[1], entry.low[2]}, {entry.high[0], entry.high[1], entry.high[2]}};
}

/// Reads tetrahedra with their values. Of a series, at the volume's step. Thread-safe.
class CellTetrahedra {
 public:
  /// `attributes`: indices into VolumeInfo::attributes. `room`: for parts of the file. `summaries`: those that chunks()
  /// shows. The volume must outlive the result. Returns null if the file keeps no cells.
  [[nodiscard]] static Result<std::unique_ptr<const CellTetrahedra>> open(
      const format::Volume& volume, std::vector<std::size_t> attributes, const PartRoom& room,
      const format::SummaryAttributes& summaries = {});

  [[nodiscard]] const format::CellReader& reader() const { return *reader_; }
  [[nodiscard]] const std::vector<std::size_t>& attributes() const { return attributes_; }
  [[nodiscard]] const format::SummaryAttributes& summaries() const { return summaries_; }

  /// Cells of shapes and fields that this program does not know. They are left out.
  [[nodiscard]] std::uint64_t unknown_cells() const;

  /// Whether some cells have values of their own, instead of values at their corners.
  [[nodiscard]] bool has_constant() const;

  /// How far a position may be from a cell that it was in before the file rounded the cell's corners: world units. For
  /// a tetrahedron in this box; for any, without a box. Rounding is much finer than cells (spec, section 8).
  [[nodiscard]] double reach(const Box& tetrahedron) const {
    const dvec3 extent = tetrahedron.extent();
    return std::min(moved_, std::max({extent.x, extent.y, extent.z}) / 64) + rounding_;
  }
  [[nodiscard]] double reach() const { return moved_ + rounding_; }

  /// The part of it that is due to computed positions.
  [[nodiscard]] double rounding() const { return rounding_; }

  /// Returns chunks of known cells in the order of the file: those whose boxes `meets` accepts, and that
  /// shows(page, number in the page) accepts. Reads the pages of chunks whose boxes are accepted. A chunk takes 96
  /// bytes.
  [[nodiscard]] Result<std::vector<format::CellChunkEntry>> chunks(
      const std::function<bool(const Box&)>& meets,
      const std::function<bool(const format::CellPage&, std::size_t)>& shows = {}) const;

  /// Returns a page of chunks with its summaries.
  [[nodiscard]] Result<std::shared_ptr<const format::CellPage>> read_page(std::size_t page) const;

  [[nodiscard]] Result<Tetrahedra> read(const format::CellChunkEntry& entry) const;

  /// Reads what these chunks need ahead: of a file that is far (format::Volume::is_far) and only so much as fits into
  /// memory.
  [[nodiscard]] Result<format::CellsAhead> read_ahead(std::span<const format::CellChunkEntry> entries) const;

  /// Reads chunks on several threads: calls work(entry, tetrahedra, part) with a new `Part` for each, and then
  /// take(entry, part) in the order of `entries`, on this thread. Holds a few chunks and parts at a time. Both return a
  /// Status.
  template <class Part, class Work, class Take>
  [[nodiscard]] Status for_each(std::span<const format::CellChunkEntry> entries, const Work& work, const Take& take,
                                std::size_t threads = std::max(1u, std::thread::hardware_concurrency())) const {
    while (!entries.empty()) {
      const std::size_t count = count_at_once(entries);
      SPLATVOL_TRY(check_interruption());
      SPLATVOL_TRY_ASSIGN(ahead, read_ahead(entries.first(count)));
      std::vector<Part> parts(count);
      const auto run = [&](std::size_t i, std::size_t /*thread*/) -> Status {
        SPLATVOL_TRY_ASSIGN(tetrahedra, read(entries[i]));
        return work(entries[i], tetrahedra, parts[i]);
      };
      SPLATVOL_TRY(run_tasks(count, threads, run));
      for (std::size_t i = 0; i < count; ++i) SPLATVOL_TRY(take(entries[i], parts[i]));
      entries = entries.subspan(count);
    }
    return {};
  }

 private:
  CellTetrahedra(std::unique_ptr<const format::CellReader> reader, std::vector<std::size_t> attributes,
                 const PartRoom& room, const format::SummaryAttributes& summaries);
  [[nodiscard]] PartKey key_of_page(std::size_t page) const;
  [[nodiscard]] static std::size_t count_at_once(std::span<const format::CellChunkEntry> entries);
  [[nodiscard]] Status read_values(std::span<const std::uint64_t> ranks, Tetrahedra& tetrahedra) const;

  std::unique_ptr<const format::CellReader> reader_;
  std::vector<std::size_t> attributes_;
  format::SummaryAttributes summaries_;
  PartRoom room_;
  format::RankedPoints points_;
  format::CellVertices vertices_;
  double moved_, rounding_;  // most that a corner is away from that of the input; of computed positions
};

}  // namespace splatvol
