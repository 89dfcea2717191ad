// The boundary with fewer triangles.
#pragma once

#include <cstdint>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "builder/boundary/boundary_faces.h"

namespace splatvol {

/// The boundary, as it is stored.
struct Boundary {
  std::vector<Patch> patches;    // by their names; then the rest, unless it is empty: whole, or its parts by size;
                                 // then the sides of the box
  double error = 0;              // no point of the mesh's boundary is farther from these triangles
  std::uint64_t triangles = 0;   // of the mesh's boundary
  std::uint64_t kept = 0;        // of `patches`
  std::uint64_t held_bytes = 0;  // memory that this took, about
};

/// Returns all triangles. The rest is split into the sides of the box round all outer faces and its connected parts
/// (rest_parts.h), unless the input has a patch with the name of the rest, a side or a part. A face that lies within
/// a larger one of the cell beyond (hanging nodes) is inside, and so is that one. Called once for `faces`. Fails if
/// there is none.
[[nodiscard]] Result<Boundary> whole_boundary(BoundaryFaces& faces);

/// Returns at most `most_triangles` triangles, in the same patches. Edges that patches share stay shared. Up to 2^21
/// triangles, or twice `most_triangles`, are held at once. If there are more, their points are joined in small cells
/// first (WeldedSurface), and the rest is split after this. The result does not depend on memory and threads. Requires
/// most_triangles > 0. Called once for `faces`. Fails if there is none.
[[nodiscard]] Result<Boundary> simplified_boundary(BoundaryFaces& faces, std::uint64_t most_triangles);

}  // namespace splatvol
