// What kinds of cells a data set has.
#pragma once

#include "builder/mesh/cell_census.h"
#include "builder/sources/data_set.h"

namespace splatvol {

/// Whether a data set has cells with an area, and none with a volume.
[[nodiscard]] bool is_surface(const DataSet& data);

/// Counts the cells of a data set, and those without volume.
[[nodiscard]] CellCensus census_of(const DataSet& data);

}  // namespace splatvol
