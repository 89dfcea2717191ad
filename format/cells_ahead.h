// Reads what cells need before they are needed.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"

namespace splatvol::format {

/// Bytes that were read ahead. While they live, reads take them from memory.
using CellsAhead = std::vector<std::shared_ptr<const BytesAhead>>;

/// Reads chunks of cells ahead, with the positions of their corners and their values of `attributes`: of a file that is
/// far (Volume::is_far), in several steps, each in a quarter of the share at most. `points`: of the reader.
[[nodiscard]] Result<CellsAhead> read_cells_ahead(const CellReader& cells, const RankedPoints& points,
                                                  std::span<const CellChunkEntry> entries,
                                                  std::span<const int> attributes, MemoryShare& share);

}  // namespace splatvol::format
