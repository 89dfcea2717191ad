// Surfaces as patches of a boundary.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "builder/sources/data_set.h"

namespace splatvol {

/// A cell of a surface, by VTK's number of its type and its points.
struct SurfaceCell {
  int vtk_type;
  std::vector<std::uint32_t> points;
};

/// Appends cells to a mesh that has their points. Splits them into triangles as faces of volume cells are split: so a
/// cell and the face at its place have equal triangles. Cells at positions that are not finite are left out, and these
/// positions become 0. Requires indices in range.
void append_cells(std::span<const SurfaceCell> cells, TriangleMesh& mesh);

/// Appends cells, with those of `points` that they name. `mesh` may have other cells, with points of their own. Cells
/// that name points which are not there are left out.
void append_cells_of(std::span<const dvec3> points, std::vector<SurfaceCell> cells, TriangleMesh& mesh);

/// Appends the surface cells of a data set, with their points. Cells that name points which are not there are left out.
/// Throws if there are too many points.
void append_surface_cells(const DataSet& data, TriangleMesh& mesh);

}  // namespace splatvol
