// The GLM types that the project uses, and a few of its own.
#pragma once

#include <bit>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>

#include "splatvol/geometry.h"

namespace splatvol {

using glm::dmat3;
using glm::dvec2;
using glm::vec3;

/// Rounds to the nearest integer, ties to the even one; faster than the library's functions. Requires
/// |number| < 2^51.
[[nodiscard]] inline std::int64_t nearest_integer(double number) {
  constexpr double shift = 0x1.8p52;  // the doubles near it are the integers
  return std::bit_cast<std::int64_t>(number + shift) - std::bit_cast<std::int64_t>(shift);
}

[[nodiscard]] inline double squared_length(const dvec3& v) { return glm::dot(v, v); }

/// The number of the largest component, ties to the first.
[[nodiscard]] inline int longest_axis(const dvec3& extent) {
  return extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
}

/// An axis-parallel cube in world units: a node of an octree.
struct Cube {
  dvec3 origin{0};  // the corner with the lowest coordinates
  double edge = 0;
};

/// The square of the smallest distance between a box and a position, or two boxes: 0 where they touch.
[[nodiscard]] inline double squared_distance(const Box& box, const dvec3& position) {
  return squared_length(glm::max(glm::max(box.low - position, position - box.high), dvec3(0)));
}
[[nodiscard]] inline double squared_distance(const Box& a, const Box& b) {
  return squared_length(glm::max(glm::max(a.low - b.high, b.low - a.high), dvec3(0)));
}

}  // namespace splatvol
