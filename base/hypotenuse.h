// The length of a plane vector, with the same bits on all systems.
#pragma once

#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {

/// Returns sqrt(x^2 + y^2) within 1 unit in the last place, of numbers of any size. It has the bits of `hypot` since
/// glibc 2.35; earlier ones differ, and a program that calls it does not run with them. After Borges, "An Improved
/// Algorithm for hypot(a,b)" (2019): a root, corrected by its remainder.
[[nodiscard]] inline double hypotenuse(double x, double y) {
  double longer = std::abs(x), shorter = std::abs(y);
  if (std::isinf(longer) || std::isinf(shorter)) return std::numeric_limits<double>::infinity();
  if (longer < shorter) std::swap(longer, shorter);
  if (!(0x1p54 * shorter > longer)) return longer + shorter;  // NaN, too
  // By a power of 2, which rounds nothing, to where squares neither overflow nor lose bits.
  const double scale = longer > 0x1p511 ? 0x1p-600 : shorter < 0x1p-459 ? 0x1p600 : 1;
  longer *= scale, shorter *= scale;
  const double root = std::sqrt(longer * longer + shorter * shorter);
  // root^2 - longer^2 - shorter^2, by differences that are exact or small.
  double remainder;
  if (root <= 2 * shorter) {
    const double rest = root - shorter;
    remainder = longer * (2 * rest - longer) + (rest - 2 * (longer - shorter)) * rest;
  } else {
    const double rest = root - longer;
    remainder = 2 * rest * (longer - 2 * shorter) + ((4 * rest - shorter) * shorter + rest * rest);
  }
  return (root - remainder / (2 * root)) / scale;
}

}  // namespace splatvol
