// Pictures: linear premultiplied RGBA in 32-bit float, to and from OpenEXR and PNG, and their comparison.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"

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
[[nodiscard]] Status write_image(const std::string& path, const Image& image, dvec3 background,
                                 const Provenance& provenance, bool transparent = false);

/// Returns whether write_image knows the extension of `path`. Lets a program refuse before it works for minutes.
[[nodiscard]] bool is_image_path(const std::string& path);

/// Reads an EXR file with channels R, G, B and optionally A (1 if absent). Safe on untrusted files as far as OpenEXR
/// is.
[[nodiscard]] Result<Image> read_exr(const std::string& path);

struct ImageDifference {
  double rmse;            // of linear premultiplied RGB, over all pixels and the three channels
  double psnr;            // -20 log10(rmse), dB for a peak of 1; infinity if the pictures are equal
  double max;             // largest absolute difference of a channel, alpha left out
  double mean_a, mean_b;  // mean of RGB
};

/// Compares two pictures. Fails if their sizes differ or they are empty.
[[nodiscard]] Result<ImageDifference> compare_images(const Image& a, const Image& b);

/// What a person sees of the error of a picture, in linear premultiplied RGB. The outline is where the exact alpha
/// crosses 1/255 between neighbours. Pixels belong to it up to 3 pixels away.
struct SeenDifference {
  double ripple;   // RMSE beside the outline of what is narrower than about 16 pixels
  double outline;  // RMSE at the outline; 0 without one
};

/// Compares a picture with the exact one. `ripple` takes the difference without its mean round each pixel: that of the
/// pixels beside the outline, weighted by a Gaussian with a standard deviation of 16 sqrt(ln 2 / 2) / pi = 2.998
/// pixels. So a wave with a period of 16 pixels keeps half of its height. Fails as compare_images does.
[[nodiscard]] Result<SeenDifference> compare_as_seen(const Image& exact, const Image& picture);

}  // namespace splatvol
