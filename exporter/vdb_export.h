// A file's splats as voxels, without loss of mass.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "exporter/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct VdbReport {
  std::uint64_t splats = 0;  // that reach into the box
  std::uint64_t voxels = 0;  // with material
  double splat_mass = 0;     // of these splats
  double voxel_mass = 0;     // what of it lies in voxels: all, without a box
  std::uint64_t file_bytes = 0;
};

/// Spreads each splat's mass over the voxels that its kernel reaches (exporter/voxel_kernel.h), and writes the grids
/// "volume_fraction", volume of material per volume of voxel, and each selected attribute, the mean of its value over
/// the material that has one, active where that fills more than a thousandth of the voxel. With a box, voxels whose
/// centres lie in it.
///
/// `voxel`: edge, world units; the centre of voxel (0, 0, 0) is the origin of the file's cube. `memory`: bytes that the
/// voxels may take. The file is read by groups of points, never whole. Output does not depend on threads or memory.
/// Fails where an attribute is called as the other grid, where there are too many voxels along an axis or no material,
/// and where more memory is needed, with out_of_budget.
[[nodiscard]] Result<VdbReport> export_vdb(const format::Volume& volume, const std::string& path,
                                           const ExportSelection& selection, double voxel, std::uint64_t memory,
                                           const std::function<void(double)>& progress);

}  // namespace splatvol
