// Clips splats at the faces of a box.
#pragma once

#include <span>

#include "base/math.h"
#include "streamer/splat.h"

namespace splatvol {

/// Clips splats of the kernel moments, taking their material as normally distributed. Mass, centroid and value become
/// exactly those of the material inside the box; the deviations change along the splat's axes, which stay. A splat that
/// has no boundary and loses a good part gets the face as its boundary. A splat outside gets mass 0. `box`: in the
/// splats' units, relative to the origin of their positions.
void clip(std::span<MomentsSplat> splats, const Box& box);

/// Clips splats of the kernel octant: a splat stays whole if its point is in the box, else its value becomes missing.
void clip(std::span<OctantSplat> splats, const Box& box);

}  // namespace splatvol
