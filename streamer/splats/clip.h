// Clips splats at the faces of a box, and at planes.
#pragma once

#include "base/math.h"
#include "scene/scene.h"
#include "splat/record.h"

namespace splatvol {

/// Clips a splat of the kernel moments, taking its material as normally distributed. Mass, centroid and value become
/// exactly those of the material inside the region; the deviations change along the splat's axes, which stay. A splat
/// that has no boundary and loses a good part gets the face as its boundary. A splat outside gets mass 0. `region`: in
/// drawing units, relative to the origin of the splat's centre. Returns whether the splat has changed.
bool clip(MomentsSplat& splat, const ClipRegion& region);

/// Clips a splat of the kernel octant: it stays whole if its point is in the region, else its value becomes missing.
bool clip(OctantSplat& splat, const ClipRegion& region);

/// A range of records in a region.
struct ClippedRange {
  enum class Part {
    all,   // draw the range as it is
    none,  // draw nothing
    some,  // draw `row` instead: a record for each of the range
  };
  Part part = Part::all;
  RecordRow row;  // none unless Part::some
};

/// Clips the records of a range. `region`: world units; `length`: of a drawing unit, in world units.
[[nodiscard]] ClippedRange clip(const DrawRange& range, const ClipRegion& region, double length);

}  // namespace splatvol
