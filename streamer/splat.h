// Splats for the renderer, in batches with a common origin.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// The shape of splats.
enum class KernelKind {
  octant,   // balls, as large as the leaf of the octree: Meredith and Ma 2001
  moments,  // ellipsoids that match the material
};

/// A splat of the kernel `octant`, in the layout of the renderer's buffers.
struct OctantSplat {
  vec3 position;  // relative to its batch's origin, world units
  float value;    // less the attribute's offset, for which single precision is too coarse; NaN: missing, draws nothing
  float size;     // d: thickness and diameter scale, world units
  std::uint32_t gradient;  // direction of the value's gradient, for lighting: 4 signed bytes / 127, the last 0; 0: none
};
static_assert(sizeof(OctantSplat) == 24);

/// A splat of the kernel `moments`, in the layout of the renderer's buffers.
struct MomentsSplat {
  vec3 position;               // centroid relative to its batch's origin, world units
  float mass;                  // volume of the material that has a value, times its density; 0 draws nothing
  vec3 deviations;             // along the principal axes, descending, world units
  vec3 orientation;            // x, y, z of the unit quaternion that turns x, y, z onto the principal axes; w >= 1/2
  float value;                 // mean, less the attribute's offset
  float value_deviation;       // standard deviation of the value
  std::uint32_t correlations;  // 4 signed bytes / 127: of the value with each principal axis; then the residual, [0, 1]
  std::uint32_t boundary;      // 3 signed numbers of 10 bits / 128, lowest first: format::SplatShape::boundary
};
static_assert(sizeof(MomentsSplat) == 56);

/// Bytes of a splat.
[[nodiscard]] constexpr std::size_t splat_bytes(KernelKind kernel) {
  return kernel == KernelKind::octant ? sizeof(OctantSplat) : sizeof(MomentsSplat);
}

/// `octant`: how far a splat reaches from its centre, in units of its size (3 standard deviations of 0.4 d), and the
/// least reach, in pixels: the renderer widens splats that could fall between the centres of pixels.
inline constexpr double octant_reach = 1.2;
inline constexpr double octant_smallest_reach_pixels = 1.5;

/// `moments`: how far a splat reaches out of its node, in units of its size (spec/svol-1.md, section 6), and how far
/// the low-pass filter adds to it, in pixels.
inline constexpr double moments_reach = 2;
inline constexpr double moments_smallest_reach_pixels = 1.5;

/// Splats of one kind.
using SplatSpan = std::variant<std::span<const OctantSplat>, std::span<const MomentsSplat>>;

/// Consecutive splats of one node with a common origin: positions relative to it keep their detail in single precision,
/// even far from the world's origin.
struct SplatBatch {
  dvec3 origin;
  std::uint64_t first;
  std::uint64_t count;
  float weight = 1;  // [0, 1]: factor on the splats' mass, and so on their optical depth; 0 draws nothing
};

}  // namespace splatvol
