// Splats cut off at a box's faces.
#pragma once

#include <span>

#include "base/math.h"
#include "streamer/splat.h"

namespace splatvol {

/// Leaves of each splat what of its material lies within the box, taken as normally distributed: mass, centroid and
/// value exactly, deviations along the axes that it has; the face becomes its boundary where it has none and a good
/// part is cut off. What is outside gets mass 0. `origin`: that of the splats' positions.
void clip(std::span<MomentsSplat> splats, const dvec3& origin, const Box& box);

/// Splats of the kernel octant are there as a whole where their point is within the box; others lose their value.
void clip(std::span<OctantSplat> splats, const dvec3& origin, const Box& box);

}  // namespace splatvol
