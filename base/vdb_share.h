// Metadata of OpenVDB files that svexport writes and svbuild reads.
#pragma once

namespace splatvol {

/// Flag of the grid that holds the volume of material per volume of voxel. At most one grid of a file has it.
inline constexpr const char* vdb_share_metadata = "svol_volume_fraction";

}  // namespace splatvol
