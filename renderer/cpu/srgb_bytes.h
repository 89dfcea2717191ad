// Turns pictures into the bytes that a window shows.
#pragma once

#include <cstdint>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"

namespace splatvol {

/// Lays a picture in linear premultiplied RGBA over a background, and encodes it by the sRGB curve, on all threads.
/// `bytes` gets red, green, blue and 255 for each pixel, in the image's order. They differ from srgb_of by rounding, to
/// 8e-6 of the range. NaN gives any byte.
void encode_srgb(const Image& image, dvec3 background, std::vector<std::uint8_t>& bytes);

}  // namespace splatvol
