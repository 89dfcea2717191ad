// Exodus, through VTK's reader.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Opens an Exodus file: each block of cells is a portion (builder/sources/vtk/block_reader.h).
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_exodus(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
