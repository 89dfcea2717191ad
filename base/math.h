// GLM, with the settings that every file of the project shares.
#pragma once

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

namespace splatvol {

using glm::dmat3;
using glm::dvec2;
using glm::dvec3;
using glm::vec3;
using glm::vec4;

/// An axis-aligned cube in world units; the octree's root.
struct Cube {
  dvec3 origin{0};  // the corner with the lowest coordinates
  double edge = 0;
};

}  // namespace splatvol
