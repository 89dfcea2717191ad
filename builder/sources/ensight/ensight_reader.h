// EnSight, through VTK's reader.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Opens an EnSight case: the whole mesh is one portion (builder/sources/vtk/block_reader.h).
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_ensight(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
