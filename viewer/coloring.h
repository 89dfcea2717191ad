// Colours of contours and surfaces by an attribute.
#pragma once

#include "format/volume_info.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns how the scene colours something by an attribute: as it does already, or as the volume if that shows the same
/// attribute; else by the attribute's whole range.
[[nodiscard]] SceneColoring coloring_by(const Scene& scene, const format::Attribute& attribute);

}  // namespace splatvol
