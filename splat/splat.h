// Splats: their kernels, their units, and how far they reach.
#pragma once

#include <cmath>
#include <cstdint>

#include "base/math.h"

namespace splatvol {

/// The shape of splats.
enum class KernelKind {
  octant,   // balls, as large as the leaf of the octree: Meredith and Ma 2001
  moments,  // ellipsoids that match the material
};

/// The units of splats. Single precision holds numbers near 1 best, whatever the units of the file.
struct DrawingUnits {
  double length = 1;          // in world units
  double value_offset = 0;    // of the attribute
  double value_scale = 1;     // of the attribute
  double cube = 1;            // edge of the file's cube, in units of `length`
  double opacity_offset = 0;  // of the opacity attribute
  double opacity_scale = 1;

  /// Returns the value of a stored value.
  [[nodiscard]] double value(double stored) const { return value_offset + value_scale * stored; }

  /// Returns a volume in cubed world units.
  [[nodiscard]] double volume(double cubed_units) const { return cubed_units * length * length * length; }

  [[nodiscard]] bool operator==(const DrawingUnits&) const = default;
};

/// Returns the unit of length for a file whose cube has this edge: a power of two, 1 for an ordinary edge. It is about
/// a thousandth of other edges. Then single precision holds the masses of splats down to 1e-15 of the edge.
[[nodiscard]] inline double drawing_length(double edge) {
  const int exponent = std::ilogb(edge);
  return exponent >= -10 && exponent < 20 ? 1.0 : std::ldexp(1.0, exponent - 10);
}

/// A splat of the kernel `octant` in numbers, for what is not a rasterizer. In DrawingUnits.
struct OctantSplat {
  vec3 position;           // relative to an origin
  float value;             // stored value; NaN: missing, draws nothing
  float size;              // d: thickness and diameter scale
  std::uint32_t gradient;  // direction of the value's gradient, for lighting: 4 signed bytes / 127, the last 0; 0: none
};

/// `octant`: how far a splat reaches from its centre, in units of its size (3 standard deviations of 0.4 d), and the
/// least reach, in pixels: the renderer widens splats that could fall between the centres of pixels.
inline constexpr double octant_reach = 1.2;
inline constexpr double octant_smallest_reach_pixels = 1.5;

/// `moments`: how far a splat reaches out of its node, in units of its size (spec/svol-1.md, section 6), and how far
/// the low-pass filter adds to it, in pixels.
inline constexpr double moments_reach = 2;
inline constexpr double moments_smallest_reach_pixels = 1.5;

}  // namespace splatvol
