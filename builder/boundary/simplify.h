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
  std::vector<Patch> patches;    // in the order of their names; the rest comes last, unless it is empty
  double error = 0;              // no point of the mesh's boundary is farther from these triangles
  std::uint64_t triangles = 0;   // of the mesh's boundary
  std::uint64_t kept = 0;        // of `patches`
  std::uint64_t held_bytes = 0;  // memory that this took, about
};

/// Returns all triangles. A face that lies within a larger one of the cell beyond (hanging nodes) is inside, and so is
/// that one. Called once for `faces`. Fails if there is none.
[[nodiscard]] Result<Boundary> whole_boundary(BoundaryFaces& faces);

/// Returns at most `most_triangles` triangles. Edges that patches share stay shared. Up to 2^21 triangles, or twice
/// `most_triangles`, are held at once. If there are more, their points are joined in small cells first (WeldedSurface).
/// The result does not depend on memory and threads. Requires most_triangles > 0. Called once for `faces`. Fails if
/// there is none.
[[nodiscard]] Result<Boundary> simplified_boundary(BoundaryFaces& faces, std::uint64_t most_triangles);

}  // namespace splatvol
