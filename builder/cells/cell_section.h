// The section of cells (spec/svol-1.md, section 14).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/cells/mesh_cells.h"
#include "format/chunk_source.h"

namespace splatvol {

/// How many cells were kept, and what became of the others.
struct CellReport {
  std::uint64_t cells = 0;
  std::uint64_t collapsed = 0;  // left out: two of their corners have become one point
  std::uint64_t turned = 0;     // by rounding
  double volume = 0;            // of all cells, as stored
  double turned_volume = 0;
  std::uint64_t bytes = 0;  // of the section
};

/// Writes the section front to back through `append`. `chunks`: the rows of the file, whose points give boxes and
/// ranges. `memory`: bytes to hold; `folder`: for the rest. Works on all of TBB's threads.
[[nodiscard]] Result<CellReport> write_cells(MeshCells& cells, const std::shared_ptr<const format::ChunkSource>& chunks,
                                             std::uint64_t memory, const std::string& folder,
                                             const std::function<Status(std::span<const std::byte>)>& append,
                                             const std::function<void(double)>& progress);

}  // namespace splatvol
