// Positions and boxes in world units.
#pragma once

#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <limits>

namespace splatvol {

using glm::dvec3;
using glm::vec4;

// The libraries were built with plain vectors: no GLM_FORCE_DEFAULT_ALIGNED_GENTYPES.
static_assert(sizeof(dvec3) == 3 * sizeof(double) && sizeof(vec4) == 4 * sizeof(float));

/// An axis-aligned box in world units; empty at first.
struct Box {
  dvec3 low{std::numeric_limits<double>::infinity()};
  dvec3 high{-std::numeric_limits<double>::infinity()};

  void include(const dvec3& position) {
    low = glm::min(low, position);
    high = glm::max(high, position);
  }
  void include(const Box& other) {
    low = glm::min(low, other.low);
    high = glm::max(high, other.high);
  }

  /// Lengths of the edges. Requires that the box is not empty.
  [[nodiscard]] dvec3 extent() const { return high - low; }

  [[nodiscard]] bool operator==(const Box&) const = default;
};

}  // namespace splatvol
