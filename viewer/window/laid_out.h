// A picture of the processor in the size and the layout of its place in the window.
#pragma once

#include <cstdint>
#include <vector>

#include "player/session.h"

namespace splatvol {

/// Lays out a picture as ByteTarget::write takes it, with `width` times `height` pixels; requires a picture with
/// pixels. Stretches one of another size by linear interpolation of the bytes, as OpenGL's filter does, with its edges
/// beyond them. `top_first`: the highest row comes first, else last. One thread.
void lay_out(const EncodedPicture& picture, int width, int height, bool top_first, std::vector<std::uint32_t>& pixels);

}  // namespace splatvol
