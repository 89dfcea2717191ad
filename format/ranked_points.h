// Points of a file by their ranks: their numbers in the order of all points (spec/svol-1.md, section 14).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/cell_reader.h"
#include "format/chunk_source.h"

namespace splatvol::format {

/// Reads attributes of points that are named by their ranks. Holds parts of the file that were read last. Not
/// thread-safe.
class RankedPoints {
 public:
  using ReadRankPage = std::function<Result<RankPage>(std::size_t page)>;

  /// `memory`: bytes to hold, besides what one call needs. What `read_rank_page` needs must outlive this.
  RankedPoints(std::shared_ptr<const ChunkSource> chunks, ReadRankPage read_rank_page, std::uint64_t memory);

  /// The same for a file, at its step. The reader must outlive this.
  RankedPoints(const CellReader& cells, std::uint64_t memory);
  ~RankedPoints();

  /// A point of the file: its number in a group.
  struct Place {
    std::uint64_t group = 0;
    std::uint32_t index = 0;
  };

  /// Finds points. Requires ranks of the file; ascending ones are faster.
  [[nodiscard]] Status find(std::span<const std::uint64_t> ranks, std::vector<Place>& places);

  /// The groups of places: ascending, each once.
  [[nodiscard]] static std::vector<std::uint64_t> groups_of(std::span<const Place> places);

  /// Read the positions, or the stored values of an attribute (NaN: missing), of points that were found.
  [[nodiscard]] Status read_positions(std::span<const Place> places, std::vector<dvec3>& positions);
  [[nodiscard]] Status read_values(std::span<const Place> places, int attribute, std::vector<float>& values);

 private:
  struct Held;
  std::unique_ptr<Held> held_;
};

/// Reads positions of vertices of cells. Holds pages that were read last. Not thread-safe.
class CellVertices {
 public:
  using ReadPage = std::function<Result<std::vector<dvec3>>(std::size_t page)>;

  /// `memory`: bytes to hold, besides a page. What `read_page` needs must outlive this.
  CellVertices(ReadPage read_page, std::uint64_t memory);
  ~CellVertices();

  /// Requires vertices that are there; ascending ones are faster.
  [[nodiscard]] Status read_positions(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions);

 private:
  struct Held;
  std::unique_ptr<Held> held_;
};

}  // namespace splatvol::format
