// Random vectors that are the same with every compiler.
#pragma once

#include <glm/gtc/quaternion.hpp>

#include "base/math.h"

namespace splatvol::test {

/// Draws the last component first. The order is stated, because compilers evaluate the arguments of a call in orders of
/// their own.
template <class Vector = dvec3, class Distribution, class Generator>
[[nodiscard]] Vector random_vector(Distribution& distribution, Generator& generator) {
  Vector v(0);
  for (int axis = Vector::length() - 1; axis >= 0; --axis)
    v[axis] = static_cast<typename Vector::value_type>(distribution(generator));
  return v;
}

/// As random_vector; w is drawn last.
template <class Distribution, class Generator>
[[nodiscard]] glm::dquat random_quaternion(Distribution& distribution, Generator& generator) {
  const dvec3 v = random_vector(distribution, generator);
  return {distribution(generator), v.x, v.y, v.z};
}

}  // namespace splatvol::test
