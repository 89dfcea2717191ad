// Exact rays through some pixels of a picture: what its error is measured by.
#pragma once

#include <cstddef>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "scene/scene.h"

namespace splatvol {

/// Exact colours of some pixels, evenly spread: a picture of `view_of_rays`.
struct Rays {
  Image image = {};
  int spacing = 1;  // pixels from one to the next

  /// Returns their RGB.
  [[nodiscard]] std::vector<vec3> colors() const { return {image.pixels.begin(), image.pixels.end()}; }
};

/// Returns how many pixels apart rays are so that there are a few thousand: an odd number.
[[nodiscard]] int spacing_of_rays(int width, int height);

/// Returns the view whose pixels are every `spacing`-th of `view`: each ray goes through the middle of a pixel.
/// Requires an odd spacing.
[[nodiscard]] View view_of_rays(View view, int spacing);

/// Returns the numbers of the pixels of a picture of this size that have rays, in the order of `view_of_rays`.
[[nodiscard]] std::vector<std::size_t> pixels_of_rays(int width, int height, int spacing);

/// Returns RGB of the pixels of a picture that have rays, in the order of Rays::image.
[[nodiscard]] std::vector<vec3> at_rays(const Image& picture, const Rays& rays);

}  // namespace splatvol
