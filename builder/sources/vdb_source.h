// Voxels from OpenVDB files.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// How OpenVDB files begin.
inline constexpr std::string_view vdb_magic{" BDV\0\0\0\0", 8};

/// Opens files one after the other as one point set: a point for each active voxel and each active tile, at its centre
/// in the world, with its box as the material.
///
/// A file's grids of numbers are the attributes, in file order: one of float, double or integers gives one, one of
/// vectors as many as a vector of a mesh does; others give none. A grid without a name is called "value", the second of
/// a name "name[1]", and so on. The points are the union of the active values of the grids that are selected; a tile is
/// one point where it is a tile in all of them. A grid that is not active somewhere has no value there (NaN), as has
/// what is not finite.
///
/// A value is linear within its box, by central differences to the active values beside it, one-sided where one side is
/// not active. A box has a plane where what lies beside it is active in no grid.
///
/// A grid marked as base/vdb_share.h says is the mass of the material, in volumes of the box, whether it is selected or
/// not; a box has none where it is not active.
///
/// All grids of a file are held while it is opened, then the selected ones. Fails as open_source, and where grids that
/// are selected have different transforms, or one that is not linear, or nothing is active. `paths` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_vdb_files(const std::vector<std::string>& paths,
                                                             const std::vector<std::string>& selection);

}  // namespace splatvol
