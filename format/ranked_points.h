// Points of a file by their ranks: their numbers in the order of all points (spec/svol-1.md, section 14).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/part_table.h"
#include "format/cell_reader.h"
#include "format/chunk_source.h"

namespace splatvol::format {

/// Reads attributes of points that are named by their ranks. Holds parts of the file, decoded. Thread-safe.
class RankedPoints {
 public:
  using ReadRankPage = std::function<Result<RankPage>(std::size_t page)>;

  /// `room`: for what is held besides what calls in progress need. `read_rank_page` is called by several threads; what
  /// it needs must outlive this.
  RankedPoints(std::shared_ptr<const ChunkSource> chunks, ReadRankPage read_rank_page, const PartRoom& room);

  /// The same for a file, at its step. The reader must outlive this.
  RankedPoints(const CellReader& cells, const PartRoom& room);
  ~RankedPoints();

  /// A point of the file: its number in a group.
  struct Place {
    std::uint64_t group = 0;
    std::uint32_t index = 0;
    std::uint32_t segment = 0;
  };

  /// Finds points. Requires ranks of the file; ascending ones are faster, here and below.
  [[nodiscard]] Status find(std::span<const std::uint64_t> ranks, std::vector<Place>& places) const;

  /// The groups of places: ascending, each once.
  [[nodiscard]] static std::vector<std::uint64_t> groups_of(std::span<const Place> places);

  /// Read the positions, or the stored values of an attribute (NaN: missing), of points that were found.
  [[nodiscard]] Status read_positions(std::span<const Place> places, std::vector<dvec3>& positions) const;
  [[nodiscard]] Status read_values(std::span<const Place> places, int attribute, std::vector<float>& values) const;

  /// Reads the bytes that these points need ahead (Volume::read_ahead), with pages of ranks and of the directory, for
  /// `attributes` and, if `positions`, for positions. Returns null if nothing is read.
  [[nodiscard]] Result<std::shared_ptr<const BytesAhead>> read_ahead(std::span<const std::uint64_t> ranks,
                                                                     std::span<const int> attributes,
                                                                     bool positions) const;

 private:
  struct Held;

  std::unique_ptr<Held> held_;
};

/// Reads positions of vertices of cells. Holds pages. Thread-safe.
class CellVertices {
 public:
  using ReadPage = std::function<Result<std::vector<dvec3>>(std::size_t page)>;

  /// `room`: for pages that are held besides those in use. `read_page` is called by several threads; what it needs must
  /// outlive this.
  CellVertices(ReadPage read_page, const PartRoom& room);
  ~CellVertices();

  /// Requires vertices that are there; ascending ones are faster.
  [[nodiscard]] Status read_positions(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions) const;

 private:
  struct Held;
  std::unique_ptr<Held> held_;
};

}  // namespace splatvol::format
