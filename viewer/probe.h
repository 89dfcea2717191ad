// The value, position and opacity under the pointer.
#pragma once

#include <optional>

#include "base/math.h"
#include "scene/scene.h"
#include "streamer/record.h"

namespace splatvol {

struct Probe {
  double value;    // mean value at `position`
  dvec3 position;  // the ray has lost half of the light there that it loses in all
  double opacity;  // of the whole ray, [0, 1]
};

/// Follows the ray through (x, y), pixels from the upper left corner, through a frame's splats. Each splat is an
/// ellipsoidal Gaussian (octant: a round one) with the extinction of its mean value. None if the ray meets nothing
/// visible. `units`: of the splats.
[[nodiscard]] std::optional<Probe> probe(const DrawList& list, const TransferFunction& function,
                                         const DrawingUnits& units, const View& view, double x, double y);

/// Returns the value under (x, y) on the nearest slice of the view that has one there; none without such a slice.
/// `sliced`: FrameSplats::sliced.
[[nodiscard]] std::optional<Probe> probe_slices(const DrawList& sliced, const DrawingUnits& units, const View& view,
                                                double x, double y);

}  // namespace splatvol
