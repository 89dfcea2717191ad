// Picture formats as bytes in memory; used by image_file.cpp only.
#pragma once

#include <string>

#include "pictures/image.h"

namespace splatvol {

/// Encodes an EXR file: scan lines, ZIP, 32-bit float R, G, B, A; provenance as string attributes.
/// Requires image.pixels.size() == width * height > 0.
[[nodiscard]] Result<std::string> encode_exr(const Image& image, const Provenance& provenance);

/// Decodes any EXR file that has R, G and B in full resolution. Refuses sides above 16384. Safe on untrusted bytes as
/// far as OpenEXR is.
[[nodiscard]] Result<Image> decode_exr(const std::string& bytes);

/// Encodes a PNG file: 8-bit RGB, sRGB, with alpha if `transparent`; provenance as text chunks. Requires
/// image.pixels.size() == width * height > 0.
[[nodiscard]] Result<std::string> encode_png(const Image& image, dvec3 background, const Provenance& provenance,
                                             bool transparent);

}  // namespace splatvol
