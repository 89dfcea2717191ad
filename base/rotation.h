// Rotations as splats store them.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace splatvol {

/// Returns the rotated axes as columns. `imaginary`: x, y and z of a unit quaternion, whose real part is not negative.
[[nodiscard]] inline dmat3 rotated_axes(const vec3& imaginary) {
  const dvec3 q(imaginary);
  return glm::mat3_cast(glm::dquat(std::sqrt(std::max(0.0, 1 - glm::dot(q, q))), q.x, q.y, q.z));
}

}  // namespace splatvol
