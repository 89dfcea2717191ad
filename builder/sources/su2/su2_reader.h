// SU2's meshes.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Reads a .su2 mesh of three dimensions as one data set. Its file.values names a .csv with the values at the points, a
/// line for each point in their order, as SU2 writes its solutions; it must have the positions of the mesh. If
/// `file` asks for patches, they are the markers with faces; markers of one name are one patch, and their nodes and
/// lines are left out. Fails without values, if the file is damaged or has several zones, if a marker names a point
/// beyond those of the mesh, and if the values are of another mesh. Safe on untrusted files.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_su2(const InputFile& file, const SourceOptions& options);

/// Lists the arrays that open_su2() gives, by the heading of the .csv.
[[nodiscard]] Result<ArraysOfParts> list_su2_arrays(const InputFile& file);

}  // namespace splatvol
