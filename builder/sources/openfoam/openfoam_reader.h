// OpenFOAM's meshes and fields as data sets.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Opens a case. Each region of each processor is a data set; means of cells at points that several processors have are
/// means over the cells of all. Fails if the case is damaged or a part of it is missing. Safe on untrusted files.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_openfoam(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
