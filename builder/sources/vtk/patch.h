// Surfaces of VTK's data sets as patches of a boundary.
#pragma once

#include "base/error.h"
#include "base/triangle_mesh.h"

class vtkDataSet;

namespace splatvol {

/// Appends the surface cells of a data set as triangles: those that the faces of volume cells are split into, so that
/// both are found equal. Cells that name points which are not there, or positions that are not finite, are left out.
/// Call it inside run_vtk. Throws if there are too many points.
void append_surface_cells(vtkDataSet& data, TriangleMesh& mesh);

}  // namespace splatvol
