// Gmsh's meshes and views as data sets.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// Reads a .msh file as one data set. Views of nodes are arrays of the points, views of elements are arrays of the
/// cells, and views of elements' nodes are the means at the points. Of each view the step nearest to `options.time`
/// is read, without one the last. If `file` asks for patches, they are the physical groups of surfaces. Elements of
/// order 3 and more are not supported, except lines and surfaces. Fails as read_gmsh, and if an element or a view names
/// a node or an element that is not there.
[[nodiscard]] Result<std::unique_ptr<VtkDataSets>> open_gmsh(const VtkFile& file, const SourceOptions& options);

/// Lists the arrays that open_gmsh() gives. Fails as read_gmsh_views.
[[nodiscard]] Result<std::vector<ArrayShape>> gmsh_arrays(const std::string& path);

}  // namespace splatvol
