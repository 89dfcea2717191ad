// Files that hold several blocks and time steps: Exodus, EnSight and CGNS, through VTK's readers, and OpenFOAM.
#pragma once

#include <memory>

#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// Opens a file at the time step nearest to `options.time`, or without one at the last. Every block with points is a
/// data set, except surfaces: blocks that have cells with an area, and none with a volume. The blocks of Exodus and
/// CGNS are read one at a time, those of other formats all at once. Fails if the file cannot be read.
[[nodiscard]] Result<std::unique_ptr<VtkDataSets>> open_blocks(const VtkFile& file, const SourceOptions& options);

}  // namespace splatvol
