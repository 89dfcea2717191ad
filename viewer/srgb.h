// The sRGB curve, for what is shown beside the picture.
#pragma once

#include <algorithm>
#include <cmath>

namespace splatvol {

/// What a screen is given for a linear share of light, [0, 1].
[[nodiscard]] inline double srgb_of(double linear) {
  const double c = std::clamp(linear, 0.0, 1.0);
  return c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055;
}

[[nodiscard]] inline double linear_of(double srgb) {
  return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

}  // namespace splatvol
