// PLOT3D, through VTK's reader.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Reads a PLOT3D grid with its solution or functions, file.values (binary, any variant). Every block is a data set.
/// The format interleaves them by quantity, so all are read at once. A solution has Density, Momentum,
/// StagnationEnergy, and Pressure for a ratio of specific heats of 1.4.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_plot3d(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
