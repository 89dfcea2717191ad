// Files that VTK reads, as a Source.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/source.h"
#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// Opens files as pieces of one data set. The first piece with points fixes the attributes; all others must have them.
/// Contract as open_source; `files` must not be empty. `step`: the step that the files are, if they are one.
[[nodiscard]] Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files,
                                                             const std::vector<std::string>& selection,
                                                             std::optional<double> time,
                                                             CellValues cells = CellValues::averaged,
                                                             const MissingValues& missing_values = {},
                                                             const std::optional<TimeStep>& step = {});

/// Opens a PLOT3D grid and its solution (binary, any variant); every block is a piece. The attributes are
/// Density, Momentum, StagnationEnergy, and Pressure for a ratio of specific heats of 1.4.
[[nodiscard]] Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                                          const std::vector<std::string>& selection,
                                                          CellValues cells = CellValues::averaged,
                                                          const MissingValues& missing_values = {});

}  // namespace splatvol
