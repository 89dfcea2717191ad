// Shells that stand for contours where only splats are drawn.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Returns a scene that shows its contours as shells of the volume: for splats, which have no contours. Where values
/// run through the domain ten times over the data's `size`, in world units, a translucent shell has about the opacity
/// of its contour. Contours that are coloured by another attribute have the colour of the transfer function.
[[nodiscard]] Scene with_shells(const Scene& scene, double size);

}  // namespace splatvol
