#include "format/cells_ahead.h"

#include <utility>

#include "base/interruption.h"

namespace splatvol::format {

// The chunks tell which points they need, so they are decoded here and once more when they are used: that takes little
// beside what a server takes to answer.
Result<CellsAhead> read_cells_ahead(const CellReader& cells, const RankedPoints& points,
                                    std::span<const CellChunkEntry> entries, std::span<const int> attributes,
                                    MemoryShare& share) {
  CellsAhead ahead;
  if (!cells.volume().is_far()) return ahead;
  const auto add = [&](std::vector<ByteRange> ranges) -> Status {
    SPLATVOL_TRY_ASSIGN(bytes, cells.volume().read_ahead(std::move(ranges), share));
    ahead.push_back(std::move(bytes));
    return {};
  };
  std::vector<ByteRange> chunks, vertices;
  for (const CellChunkEntry& entry : entries) chunks.push_back(cells.range_of(entry));
  SPLATVOL_TRY(add(std::move(chunks)));
  std::vector<std::uint64_t> ranks;
  bool has_positions = false;
  for (const CellChunkEntry& entry : entries) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(chunk, cells.read_chunk(entry));
    const bool is_constant = entry.field == CellField::constant;
    has_positions = has_positions || !is_constant;
    const std::vector<std::uint64_t> corners = number_corners(chunk.corners).ranks;
    if (is_constant)
      for (const std::uint64_t vertex : corners)
        vertices.push_back(cells.range_of_vertex_page(static_cast<std::size_t>(vertex / vertex_page_points)));
    const std::vector<std::uint64_t>& of_chunk = is_constant ? chunk.points : corners;
    ranks.insert(ranks.end(), of_chunk.begin(), of_chunk.end());
  }
  SPLATVOL_TRY(add(std::move(vertices)));
  SPLATVOL_TRY_ASSIGN(bytes, points.read_ahead(ranks, attributes, has_positions));
  ahead.push_back(std::move(bytes));
  return ahead;
}

}  // namespace splatvol::format
