// The exact values on a plane through a tetrahedral mesh.
#pragma once

#include <span>
#include <vector>

#include "renderer/reference/reference.h"

namespace splatvol {

/// Returns the value of the field where each pixel's ray meets the plane, row after row from the top: NaN outside of
/// the mesh, and in cells that lack a value. `depths`: where the rays meet the plane; infinity: nowhere. Of cells that
/// overlap, the first counts. Works in parallel; the result does not depend on threads. Fails as check_mesh, and if
/// there is not a depth for each pixel.
[[nodiscard]] Result<std::vector<double>> exact_slice(const TetMesh& mesh, const View& view, const Plane& plane,
                                                      std::span<const double> depths);

}  // namespace splatvol
