// Splats at random, and a transfer function that shows them.
#pragma once

#include <cmath>
#include <cstddef>
#include <glm/gtc/quaternion.hpp>
#include <random>
#include <vector>

#include "scene/scene.h"
#include "splat/record.h"
#include "tests/support/random.h"

namespace splatvol::test {

/// Ellipsoids of sizes from `smallest` to `largest` in [-1, 1]^3, a fifth of them at boundaries.
inline std::vector<MomentsSplat> random_splats(std::size_t count, double smallest = 0.01, double largest = 0.3) {
  std::mt19937 generator(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto direction = [&] { return random_vector(unit, generator); };
  std::vector<MomentsSplat> splats(count);
  for (MomentsSplat& splat : splats) {
    const double size = smallest * std::pow(largest / smallest, 0.5 + 0.5 * unit(generator));
    splat.center = direction();
    splat.deviations = size * dvec3(1, 0.6 + 0.4 * unit(generator), 0.1);
    splat.mass = 2 * size * size * size;
    splat.orientation = glm::normalize(glm::dquat(1.5, direction()));
    splat.value = 0.5 + 0.4 * unit(generator);
    splat.value_deviation = 0.1;
    splat.correlations = 0.5 * direction();
    if (unit(generator) > 0.6) splat.boundary = direction();
  }
  return splats;
}

/// Three colours, and extinctions from 0 to `extinction`, not in their order.
inline TransferFunction lively(double extinction = 20) {
  TransferFunction function;
  function.colors = {{0, {1, 0, 0}}, {0.4, {0, 1, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 0}, {0.3, extinction}, {0.5, 0.2 * extinction}, {1, extinction}};
  return function;
}

}  // namespace splatvol::test
