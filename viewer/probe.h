// What lies under the pointer.
#pragma once

#include <optional>
#include <span>

#include "base/math.h"
#include "scene/scene.h"
#include "streamer/splat.h"

namespace splatvol {

struct Probe {
  double value;    // mean, where the ray has lost half of the light that it loses in all
  dvec3 position;  // there
  double opacity;  // of the whole ray, [0, 1]
};

/// Follows the ray through (x, y), pixels from the upper left corner, through a frame's splats: each is an ellipsoid's
/// Gaussian (octant: a ball's), of the extinction of its mean value. None where the ray meets nothing visible.
/// `value_offset`: what the splats' values have to be added to.
[[nodiscard]] std::optional<Probe> probe(const SplatSpan& splats, std::span<const SplatBatch> batches,
                                         const TransferFunction& function, double value_offset, const View& view,
                                         double x, double y);

}  // namespace splatvol
