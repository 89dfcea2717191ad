// The GLM types that the project uses, and a few of its own.
#pragma once

#include <bit>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <limits>

namespace splatvol {

using glm::dmat3;
using glm::dvec2;
using glm::dvec3;
using glm::vec3;
using glm::vec4;

/// Returns the nearest integer; halves round to even. Inline, unlike the functions of the standard library. Requires
/// |number| < 2^51.
[[nodiscard]] inline std::int64_t nearest_integer(double number) {
  constexpr double shift = 0x1.8p52;  // doubles this large are integers
  return std::bit_cast<std::int64_t>(number + shift) - std::bit_cast<std::int64_t>(shift);
}

/// An axis-parallel cube in world units: a node of an octree.
struct Cube {
  dvec3 origin{0};  // the corner with the lowest coordinates
  double edge = 0;
};

/// An axis-parallel box, in world units; empty by default.
struct Box {
  dvec3 low{std::numeric_limits<double>::infinity()};
  dvec3 high{-std::numeric_limits<double>::infinity()};

  void include(const Box& other) {
    low = glm::min(low, other.low);
    high = glm::max(high, other.high);
  }

  [[nodiscard]] bool operator==(const Box&) const = default;
};

}  // namespace splatvol
