// CGNS.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Opens a CGNS file: each zone is a portion (builder/sources/vtk/block_reader.h).
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_cgns(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
