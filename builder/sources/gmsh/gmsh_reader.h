// Gmsh's meshes and views as data sets.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Reads a .msh file as one data set. Views of nodes are arrays of the points, views of elements are arrays of the
/// cells, and views of elements' nodes are the means at the points. Of each view the step nearest to `options.time`
/// is read, without one the last. If `file` asks for patches, they are the physical groups of surfaces. Elements of
/// order 3 and more are not supported, except lines and surfaces. Fails as read_gmsh, and if an element or a view names
/// a node or an element that is not there.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_gmsh(const InputFile& file, const SourceOptions& options);

/// Lists the arrays that open_gmsh() gives. Fails as read_gmsh_views.
[[nodiscard]] Result<ArraysOfParts> list_gmsh_arrays(const InputFile& file);

}  // namespace splatvol
