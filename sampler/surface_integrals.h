// Integrals over contours and slices in the cells that a file keeps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "format/volume.h"
#include "splatvol/integrals.h"

namespace splatvol {

/// Integrates attributes over a contour or a slice, of a series at the volume's step. The surface is that of linear
/// functions in each tetrahedron (sampler/contour.h): that of the contour's values, or the distance from the plane. Its
/// triangles are cut exactly by the box, the planes and the ranges. One in a tetrahedron with a missing value does not
/// count for this attribute. A face of cells in the plane of a slice counts once, with the cell behind it.
///
/// Memory, threads and `progress` as integrate_cells (sampler/integrals.h). Fails as that does, if a contour's cells
/// have values of their own, if its value is not finite, or if a vector lacks one of its three attributes.
[[nodiscard]] Result<SurfaceIntegrals> integrate_surface(const format::Volume& volume, const SurfaceRequest& request,
                                                         std::uint64_t memory, std::size_t threads,
                                                         const std::function<void(double)>& progress);

}  // namespace splatvol
