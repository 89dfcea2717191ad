// How an OpenVDB file says how much of its voxels is material: what svexport writes and svbuild reads.
#pragma once

namespace splatvol {

/// A flag among the metadata of the one grid of a file that holds the volume of material per volume of voxel.
inline constexpr const char* vdb_share_metadata = "svol_volume_fraction";

}  // namespace splatvol
