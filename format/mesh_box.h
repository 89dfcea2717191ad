// The box round a mesh.
#pragma once

#include <optional>

#include "base/error.h"
#include "base/math.h"
#include "format/volume.h"

namespace splatvol::format {

/// Returns the box round the cells that a file keeps; none if it keeps none. Fails if the file cannot be read.
[[nodiscard]] Result<std::optional<Box>> box_of_cells(const Volume& volume);

/// Returns the box round the cells that a file keeps. Without cells: round its points, or round those of the finest
/// resolution with at most 2^20 points if there are more. Fails if the file cannot be read.
[[nodiscard]] Result<Box> mesh_box(const Volume& volume);

}  // namespace splatvol::format
