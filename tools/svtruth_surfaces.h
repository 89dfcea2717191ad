// The surfaces of a scene, as svtruth draws them.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "builder/boundary/simplify.h"
#include "renderer/reference/reference.h"

namespace splatvol {

/// Returns the patches of a boundary that a pattern names, as one mesh. Fails if there is none; the message begins with
/// `path`.
[[nodiscard]] Result<TriangleMesh> join_patches(const std::string& path, const std::string& pattern,
                                                const Boundary& boundary);

/// Returns the values of a mesh at positions: the linear interpolation in the tetrahedron that a position is in, or the
/// value of the tetrahedron. NaN where no tetrahedron with a value is. Of several at a position, the first counts.
/// Requires fewer than 2^32 - 1 positions.
[[nodiscard]] std::vector<double> sample_mesh(const TetMesh& mesh, std::span<const dvec3> positions);

}  // namespace splatvol
