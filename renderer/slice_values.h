// The values of splats on a plane.
#pragma once

#include <span>
#include <vector>

#include "scene/scene.h"
#include "splat/record.h"
#include "splat/splat.h"

namespace splatvol {

/// Returns the value where each pixel's ray meets the plane, row after row from the top: NaN where there is no material
/// with a value. `depths`: where the rays meet the plane; infinity: nowhere. `units`: of the splats.
///
/// The value is the mean of the splats' linear fields, weighted by the density of their kernel. Material ends where the
/// density is low, and at the boundary planes of most of the splats there. Works in parallel; the result does not
/// depend on threads. Takes 24 bytes for each pixel, and up to 60 MB for splats.
[[nodiscard]] std::vector<double> slice_values(const DrawList& list, const DrawingUnits& units, const View& view,
                                               const Plane& plane, std::span<const double> depths);

}  // namespace splatvol
