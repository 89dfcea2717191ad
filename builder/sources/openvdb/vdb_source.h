// Voxels and tiles of OpenVDB files as points.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

/// The first bytes of every OpenVDB file.
inline constexpr std::string_view vdb_magic{" BDV\0\0\0\0", 8};

/// Opens files one after the other as one point set. Each active voxel and each active tile is a point at its centre in
/// the world, with its box as the material.
///
/// The attributes are the grids of numbers of all files, in the order of the first; a file that lacks one has missing
/// values there, but needs one of them. A grid of float, double or integers gives one
/// attribute; a grid of vectors gives as many as a vector of a mesh; other grids give none. A grid without a name is
/// called "value"; the second grid of a name is called "name[1]", and so on. The points are the union of the active
/// values of the selected grids; a tile is one point if it is a tile in all of them. A value is missing (NaN) if its
/// grid is not active there, or if `missing` has it.
///
/// A value is linear within its box, by central differences to the active values beside it; if one side is not active,
/// by one-sided differences. A box has a boundary plane if no grid is active beside one of its faces.
///
/// A grid that is marked as in base/vdb_share.h is the mass of the material, in volumes of the box, whether it is
/// selected or not. A box has no mass if that grid is not active there.
///
/// All grids of a file are held while it is opened, then the selected ones. Fails as open_source, and if the selected
/// grids have different transforms, if a transform is not linear, or if nothing is active. `paths` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_vdb_files(const std::vector<std::string>& paths,
                                                             const SourceOptions& options);

/// Lists the grids of numbers of files, by their headers.
[[nodiscard]] Result<std::vector<ArrayShape>> list_vdb_grids(const std::vector<std::string>& paths);

}  // namespace splatvol
