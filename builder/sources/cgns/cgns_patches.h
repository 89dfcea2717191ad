// Patches of CGNS files, which VTK's reader leaves out.
#pragma once

#include <string>
#include <vector>

#include "base/triangle_mesh.h"

namespace splatvol {

/// Reads the boundary conditions of all zones with volume cells: their patches have the name of the family, else of the
/// condition. They may be ranges of points of a structured zone, or ranges and lists of surface cells of an
/// unstructured one, polygons among them. Other surface cells are patches with the name of their section, but not
/// polygons: most of them are faces between cells. Other kinds, and damaged parts, are left out. Throws if the file
/// cannot be opened.
[[nodiscard]] std::vector<Patch> read_cgns_patches(const std::string& path);

}  // namespace splatvol
