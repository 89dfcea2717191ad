// Exports a file's splats as voxels, without loss of mass.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "format/volume.h"
#include "tools/export/splat_groups.h"

namespace splatvol {

struct VdbReport {
  std::uint64_t splats = 0;  // splats that reach into the box
  std::uint64_t voxels = 0;  // voxels with material
  double splat_mass = 0;     // of these splats
  double voxel_mass = 0;     // mass in voxels: without a box, all mass of the splats
  std::uint64_t file_bytes = 0;
  std::map<std::string, std::string> renamed;  // grids whose usual name an attribute has: their names in the file
};

/// Spreads the mass of each splat over the voxels that its kernel reaches (tools/export/voxel_kernel.h), and writes
/// grids:
/// - "volume_fraction": volume of material per volume of voxel;
/// - one for each selected attribute: the mean of its value over the material that has a value. A voxel is active if
///   this material fills more than a thousandth of it.
/// An attribute keeps its name. If one is called "volume_fraction", the grid of the fraction gets the first free name
/// of "volume_fraction (splat)", "volume_fraction (splat 2)" and so on; its metadata tell which it is
/// (base/vdb_share.h). With a box, writes only voxels whose centres are in it.
///
/// `voxel`: edge, world units; the centre of voxel (0, 0, 0) is the origin of the file's cube. `memory`: most bytes for
/// the voxels. Reads the file group by group, never whole. Output does not depend on threads or memory. The file has
/// the mark of an export (base/replaceable.h). Fails if the selection has two attributes of one name, if there are too
/// many voxels along an axis, if there is no material, or if `path` may not be replaced. Fails with out_of_budget if
/// `memory` does not suffice.
[[nodiscard]] Result<VdbReport> export_vdb(const format::Volume& volume, const std::string& path,
                                           const format::SplatSelection& selection, double voxel, std::uint64_t memory,
                                           const std::function<void(double)>& progress,
                                           Replace replace = Replace::exports);

}  // namespace splatvol
