// Files that VTK reads, as a Source.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/source.h"
#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// Opens files as pieces of one data set. The attributes are those of all pieces: where a piece lacks one, its values
/// are missing. Reads the first piece with points for that, and the headers of all others. next() fails if a piece has
/// an array that no header announced. Contract as open_source; `files` must not be empty. `step`: the step that the
/// files are, if they are one.
[[nodiscard]] Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const SourceOptions& options,
                                                             const std::optional<TimeStep>& step = {},
                                                             VtkLists lists = {});

/// Lists the arrays that the headers of files announce, as list_arrays (builder/opening/open_source.h) does.
[[nodiscard]] Result<std::vector<ArrayShape>> list_vtk_arrays(const std::vector<VtkFile>& files,
                                                              const SourceOptions& options);

/// Opens a PLOT3D grid and its solution (binary, any variant); every block is a piece. The attributes are
/// Density, Momentum, StagnationEnergy, and Pressure for a ratio of specific heats of 1.4.
[[nodiscard]] Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                                          const SourceOptions& options);

}  // namespace splatvol
