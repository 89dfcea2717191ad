// Samples farther apart than pixels, and the picture between them. Internal to the tiles.
#pragma once

#include "pictures/image.h"
#include "scene/scene.h"

namespace splatvol::tiles {

/// Returns `view` with one sample for every `spacing` x `spacing` pixels, and one beyond each end at most, so that all
/// pixels lie between samples. The middle of the picture stays the same point.
[[nodiscard]] View sampled_view(View view, int spacing);

/// Makes a picture of this size from `samples`, a picture of its sampled_view: by cubics that do not overshoot, so that
/// thin bright lines keep their light, one axis after the other. `rows`: scratch memory.
void interpolate(const Image& samples, int spacing, Image& rows, Image& picture);

}  // namespace splatvol::tiles
