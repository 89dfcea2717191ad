// Pictures: linear premultiplied RGBA in 32-bit float, written as OpenEXR and PNG.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "splatvol/error.h"
#include "splatvol/export.h"
#include "splatvol/geometry.h"

namespace splatvol {

struct Image {
  int width = 0;
  int height = 0;
  std::vector<vec4> pixels;  // row 0 at the top; premultiplied, background not applied

  [[nodiscard]] vec4& at(int x, int y) { return pixels[static_cast<std::size_t>(y) * width + x]; }
  [[nodiscard]] const vec4& at(int x, int y) const { return pixels[static_cast<std::size_t>(y) * width + x]; }
};

/// Written into the header of an EXR file (string attributes) or a PNG file (text chunks).
using Provenance = std::map<std::string, std::string>;

/// Writes an .exr file (channels R, G, B, A; 32-bit float) or a .png file (8 bits, the image over `background`, with
/// the sRGB curve); the extension of `path` says which. The file appears whole or not at all.
/// `transparent`: a .png keeps its alpha. Programs that show it over `background` show the same picture as without.
[[nodiscard]] SPLATVOL_EXPORT Status write_image(const std::string& path, const Image& image, dvec3 background,
                                                 const Provenance& provenance, bool transparent = false);

/// Returns whether write_image knows the extension of `path`. Lets a program refuse before it works for minutes.
[[nodiscard]] SPLATVOL_EXPORT bool is_image_path(const std::string& path);

}  // namespace splatvol
