// Files that hold several blocks and time steps: Exodus, EnSight, OpenFOAM and CGNS, through VTK's readers.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/vtk/reader.h"

namespace splatvol {

/// Whether a selection of attributes needs an array: by its name, or by that of one of its components.
[[nodiscard]] bool wants_array(const std::vector<std::string>& selection, const std::string& array);

/// Opens one such file at the step nearest to `time`, the last without. Every block with a cell that has a volume, or
/// without cells, is a data set; of Exodus and CGNS one is read at a time, of the others all are read here. An array of
/// the cells becomes one of the points: at each the mean of the block's cells round it, cells with a volume where it
/// has any. An array that a block lacks is NaN there. Fails where the file cannot be read.
[[nodiscard]] Result<std::unique_ptr<VtkDataSets>> open_blocks(const VtkFile& file,
                                                               const std::vector<std::string>& selection,
                                                               std::optional<double> time);

}  // namespace splatvol
