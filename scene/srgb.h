// The sRGB curve (IEC 61966-2-1).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>

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

/// srgb_of in GLSL, for three channels. The power is a polynomial of the fourth root, to 7e-6: processors that draw a
/// window need twice as long for a power.
inline constexpr std::string_view srgb_glsl = R"(
vec3 srgb_of(vec3 linear) {
  vec3 c = clamp(linear, 0, 1);
  vec3 t = sqrt(sqrt(c));
  vec3 curve = -0.0613402194 + t * (0.162026292 + t * (1.25540433 + t * (-0.577482617 + t * (0.289532928 -
               0.0681472859 * t))));
  return mix(12.92 * c, curve, greaterThan(c, vec3(0.0031308)));
}
)";

}  // namespace splatvol
