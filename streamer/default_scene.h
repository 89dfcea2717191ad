// A first view of a volume that nobody has written a scene for.
#pragma once

#include <string>

#include "base/error.h"
#include "format/volume.h"
#include "scene/scene.h"

namespace splatvol {

/// A scene that shows the data: a transfer function over the middle 98 % of the attribute's values, cool to warm, clear
/// at the most frequent ones, with an optical depth of a few along those far from them; and a perspective camera on a
/// diagonal, so close that the points which are then visible fill the image. `attribute` empty: the first.
/// Fails where the file cannot be read, lacks the attribute (the message lists those it has) or any value of it.
[[nodiscard]] Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute);

}  // namespace splatvol
