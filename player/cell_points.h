// Points and vertices of a file's cells.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/cell_reader.h"
#include "format/volume_chunks.h"
#include "player/held_parts.h"

namespace splatvol {

/// Reads positions and values of points by their ranks, and positions of vertices by their numbers. Holds parts of the
/// file that were used last, decoded. As format::RankedPoints and format::CellVertices, but thread-safe: what several
/// chunks of cells need is read once.
class CellPoints {
 public:
  /// `memory`: bytes to hold. The reader must outlive this.
  CellPoints(const format::CellReader& cells, const format::SummaryAttributes& attributes, std::uint64_t memory);

  /// Reads values of points; NaN: missing. Clears `opacity_values` if there is no such attribute. Requires ranks of the
  /// file; ascending ones are faster. `positions`: null if they are not needed.
  [[nodiscard]] Status read(std::span<const std::uint64_t> ranks, std::vector<dvec3>* positions,
                            std::vector<double>& values, std::vector<double>& opacity_values) const;

  /// Requires vertices that are there; ascending ones are faster.
  [[nodiscard]] Status read_vertices(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions) const;

 private:
  // The segments of consecutive ranks, and the number of each point among those of its segment.
  struct Ranks {
    std::vector<std::uint8_t> segments;
    std::vector<std::uint16_t> numbers;  // less `before`
    std::vector<std::uint64_t> before;   // [segment]
  };
  using Positions = std::vector<dvec3>;
  using Values = std::vector<float>;  // as stored

  // Consecutive points of a segment.
  struct Points {
    std::uint64_t begin = 0, count = 0;
    std::shared_ptr<const Positions> positions;
    std::shared_ptr<const Values> values, opacity_values;
  };

  [[nodiscard]] Result<std::shared_ptr<const Ranks>> ranks(std::uint64_t page) const;
  [[nodiscard]] Result<Points> points_at(std::size_t segment, std::uint64_t number, bool with_positions) const;
  [[nodiscard]] Result<std::shared_ptr<const Positions>> positions_of(std::uint64_t group, std::uint32_t count) const;
  [[nodiscard]] Result<std::shared_ptr<const Values>> values_of(int attribute, std::uint64_t group,
                                                                std::uint32_t count) const;

  const format::CellReader& cells_;
  const format::VolumeInfo& info_;
  format::SummaryAttributes attributes_;
  format::VolumeChunks chunks_;
  mutable HeldParts parts_;
};

}  // namespace splatvol
