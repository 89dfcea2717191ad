// Legacy .vtk files.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Reads a file as one data set. Fails as legacy_arrays (builder/sources/vtk/legacy_checks.h), and if VTK's reader
/// does.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_legacy(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
