// The picture between samples that are farther apart than pixels. Internal to the tiles.
#pragma once

#include "pictures/image.h"

namespace splatvol::tiles {

/// Makes a picture of this size from `samples`, a picture of its sampled_view: by cubics that do not overshoot, so that
/// thin bright lines keep their light, one axis after the other. `rows`: scratch memory.
void interpolate(const Image& samples, int spacing, Image& rows, Image& picture);

}  // namespace splatvol::tiles
