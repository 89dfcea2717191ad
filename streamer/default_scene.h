// A first view of a volume that has no scene.
#pragma once

#include <string>

#include "base/error.h"
#include "format/volume.h"
#include "scene/scene.h"

namespace splatvol {

/// Makes a scene that shows the data. The transfer function covers the middle 98 % of the attribute's values, from cool
/// to warm. It is clear at the most frequent values, and reaches an optical depth of a few at values far from them. The
/// camera is a perspective one on a diagonal, so close that the visible points fill the image. `attribute` empty: the
/// first. Fails if the file cannot be read, lacks the attribute (the message lists those that it has), or has no value
/// of it.
[[nodiscard]] Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute);

}  // namespace splatvol
