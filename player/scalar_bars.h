// The scalar bars of a scene's picture.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "format/volume_info.h"
#include "pictures/page.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns a bar for all that colours the picture (bar_colors_of), labelled by the attributes' names and units. The
/// scene's unit is that of its own attribute, or of the only bar. Fails if the file lacks an attribute.
[[nodiscard]] Result<std::vector<PageBar>> scalar_bars_of(const Scene& scene, const format::VolumeInfo& info,
                                                          const std::string& file);

}  // namespace splatvol
