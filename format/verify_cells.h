// The whole-file check of cells (spec/svol-1.md, section 14). Internal to format.
#pragma once

#include <cstddef>
#include <functional>

#include "base/error.h"
#include "format/volume.h"

namespace splatvol::format {

/// Reads and checks all cells of a file, if it keeps some: their ranks against the index, boxes, areas and ranges
/// against the stored points. Requires an index that is whole: its pages are a tree. Calls `progress` with the share
/// done, on this thread. Holds some MiB for each thread.
[[nodiscard]] Status verify_cells(const Volume& volume, const std::function<void(double)>& progress,
                                  std::size_t threads);

/// Checks what the step of a series has of the cells: their ranges against its values.
[[nodiscard]] Status verify_cells_of_step(const Volume& volume, const std::function<void(double)>& progress,
                                          std::size_t threads);

}  // namespace splatvol::format
