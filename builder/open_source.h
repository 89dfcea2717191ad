// Opens any input by what is in it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens an input by what is in it: VTK files (.vtu, .pvtu, .vts, .vtr, .vti, .vtp, legacy .vtk), several of which are
/// pieces of one data set; .npy files, several of which are one point set (builder/sources/npy_source.h); a PLOT3D grid
/// and its solution as two paths in this order; OpenVDB files (builder/sources/vdb_source.h); or "gen:..." for one that
/// is made up (builder/sources/generator.h). Exodus, EnSight, OpenFOAM and CGNS files count as VTK's and are told by
/// their extensions; their blocks are pieces (builder/sources/vtk/blocks.h). A folder is an OpenFOAM case, or stands
/// for the files in it that can be read by their extensions, in the order of their names, numbers in these by size;
/// pieces that a .pvtu names are read once.
///
/// Cells become tetrahedra (builder/mesh/tetrahedra.h). Hidden cells and ghost copies are left out, with the points
/// that only they use. String arrays, ghost flags and ids are no attributes. Values that are not finite become NaN;
/// positions that are not finite stay, but no tetrahedron uses them.
///
/// Fails where a file is missing, damaged, of a kind or version that cannot be read right, has no point data, or lacks
/// a selected attribute (the message lists those that are there), and where columns are named, or a time is, of files
/// that have none.
/// Safe on untrusted files as far as VTK's and OpenVDB's readers are.
[[nodiscard]] Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& inputs,
                                                          const SourceOptions& options);

}  // namespace splatvol
