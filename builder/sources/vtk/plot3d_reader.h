// PLOT3D grids with their solutions, through VTK's reader.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// Reads the blocks of a PLOT3D grid with its solution (binary, any variant). The format interleaves the blocks by
/// quantity, so all are read here.
[[nodiscard]] Result<std::unique_ptr<VtkDataSets>> read_plot3d(const std::string& grid, const std::string& solution);

}  // namespace splatvol
