// The field of generated inputs, the box that they lie in, and the vortex's geometry.
#pragma once

#include <string>
#include <vector>

#include "base/math.h"

namespace splatvol::generated {

inline constexpr dvec3 box_low{-2, -2, -1};
inline constexpr dvec3 box_size{4, 4, 2};

inline constexpr double ring_radius = 1.2;    // of the circle that the strands follow
inline constexpr double strand_radius = 0.5;  // of the strands' way round that circle

/// An angle and its half, as cosines and sines.
struct Turn {
  double cos, sin;
  double cos_half, sin_half;

  /// The direction at one and a half times the angle.
  [[nodiscard]] dvec2 one_and_a_half() const {
    return {cos * cos_half - sin * sin_half, sin * cos_half + cos * sin_half};
  }
};

/// Rounds to single precision.
[[nodiscard]] double to_float(double value);

/// The only attribute of generated inputs: "value".
[[nodiscard]] const std::vector<std::string>& attributes();

}  // namespace splatvol::generated
