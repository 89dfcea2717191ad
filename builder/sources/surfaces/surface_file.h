// Files of surfaces: triangles to be drawn, not material.
#pragma once

#include <string>

#include "base/error.h"
#include "base/triangle_mesh.h"

namespace splatvol {

/// Reads the triangles of a .stl, .obj, .ply, .gltf, .glb, .vtp or legacy .vtk file; polygons and strips are cut into
/// triangles. Lines and points are left out, and so are triangles at a coordinate that is not finite, beyond 1e50, or a
/// fill value. Fails if no triangle is left, if the file is cut off or names corners that are not there, as far as its
/// format tells, and where VTK's reader does. Errors begin with the path. Trusts the file
/// as VTK's readers do: for the reader process.
[[nodiscard]] Result<TriangleMesh> read_surface_file(const std::string& path);

}  // namespace splatvol
