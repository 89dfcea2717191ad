// What the clip region leaves of a ray.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Depths (view coordinate z) between which something is shown; empty unless from < to.
struct VisibleDepths {
  double from, to;
};

/// Returns the depths at which a ray is in front of the eye and in the clip region. The ray has the points (a z, b z,
/// z) in perspective, and (a, b, z) in orthographic projection.
[[nodiscard]] VisibleDepths clipped_depths(const View& view, double a, double b);

}  // namespace splatvol
