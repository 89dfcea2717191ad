// Reads pictures (splatvol/image.h), and compares them.
#pragma once

#include <string>

#include "base/error.h"
#include "base/math.h"
#include "splatvol/image.h"

namespace splatvol {

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
