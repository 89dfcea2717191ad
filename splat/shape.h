// What a splat stands for: its material, and a value there.
#pragma once

#include "base/math.h"

namespace splatvol {

/// Mass and principal axes of a cluster's material, with the two numbers that drawing needs besides: the boundary and
/// the density. The column `moments` has one for each point.
struct SplatShape {
  double mass = 0;                     // volume, >= 0
  dvec3 deviations{0};                 // along the principal axes, descending
  glm::dquat orientation{1, 0, 0, 0};  // unit; turns x, y, z onto the principal axes
  dvec3 boundary{0};   // from the centroid to the foot of the perpendicular on the boundary plane, in deviations along
                       // the principal axes, under 4; 0: no boundary
  double density = 1;  // factor on the splat's density, 1/16 to 15
};

/// Returns by how far the reflection of the material in its boundary plane moves the centroid, in world units; 0
/// without a boundary (docs/design.md, "A splat").
[[nodiscard]] inline dvec3 reflection_shift(const SplatShape& shape) {
  if (shape.boundary == dvec3(0)) return dvec3(0);
  return glm::mat3_cast(shape.orientation) * (shape.deviations * shape.boundary);
}

/// Distribution of a value over a cluster's material. The column `value_moments` has one for each point.
struct SplatValue {
  double mean = 0;       // stored value
  double deviation = 0;  // standard deviation
  dvec3 correlation{0};  // with the position along each principal axis, [-1, 1]
  double residual = 0;   // deviation from the linear field, as a share of `deviation`, [0, 1]
  double coverage = 0;   // share of the mass that has a value, [0, 1]; 0: the other numbers mean nothing
};

}  // namespace splatvol
