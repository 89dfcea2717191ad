// The sRGB curve (IEC 61966-2-1).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace splatvol {

/// Encodes a linear share of light. Shares outside of [0, 1] count as the nearer end; NaN stays NaN.
[[nodiscard]] inline double srgb_of(double linear) {
  const double c = std::clamp(linear, 0.0, 1.0);
  return c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055;
}

/// Decodes an sRGB number of [0, 1]: the inverse of srgb_of.
[[nodiscard]] inline double linear_of(double srgb) {
  return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

/// Decodes an sRGB number of 8 bits.
[[nodiscard]] inline double linear_of_byte(std::uint8_t byte) { return linear_of(byte / 255.0); }

}  // namespace splatvol
