// What the streamer hands to the renderer: decoded splats, in batches with a common origin.
#pragma once

#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// A splat of the paper's kernel (`octant`), as the renderer's buffers hold it.
struct OctantSplat {
  vec3 position;  // relative to its batch's origin, world units
  float value;    // less the attribute's offset, which single precision could not hold; NaN: missing, draws nothing
  float size;     // d: thickness and diameter scale, world units
};
static_assert(sizeof(OctantSplat) == 20);

/// How far a splat reaches from its centre, in units of its size (3 standard deviations of 0.4 d), and at least, in
/// pixels: the renderer widens splats that would slip between the centres of pixels.
inline constexpr double octant_reach = 1.2;
inline constexpr double octant_smallest_reach_pixels = 1.5;

/// Splats near one origin, so that single precision keeps their detail far from the world's origin.
struct SplatBatch {
  dvec3 origin;
  std::span<const OctantSplat> splats;
};

}  // namespace splatvol
