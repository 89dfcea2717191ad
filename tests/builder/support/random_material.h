// Random material for points, for the builder's tests.
#pragma once

#include <cmath>
#include <random>

#include "builder/points/point_batch.h"
#include "tests/support/random.h"

namespace splatvol::test {

/// Replaces the material of all points. Its sizes span decades. Some points have no material, some no value, and half
/// of them a boundary. Covariances are positive definite, with one axis 1e-4 as long as the others. Requires one
/// attribute.
inline void randomize_material(PointBatch& points) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  const auto shift = [&] { return random_vector(uniform, random) - 0.5; };
  const std::size_t n = points.size();
  points.moments.assign(n, {});
  points.planes.assign(n, {});
  points.value_moments.assign(1, std::vector<ValueMoments>(n));
  points.gradients.assign(1, std::vector<dvec3>(n));
  for (std::size_t i = 0; i < n; ++i) {
    const double size = std::pow(10.0, -1 - 4 * uniform(random)), square = size * size, value = uniform(random);
    points.gradients[0][i] = random() % 8 == 0 ? dvec3(0) : 100.0 * shift();
    if (random() % 8 == 0) continue;
    // Some lie so far away that the reach out of a node, and not the width, makes the splat's size.
    const double away = random() % 4 == 0 ? 50 : 1;
    SpatialMoments& moments = points.moments[i];
    moments = {square * size, away * size * shift(), {square, 0.1 * square, 1e-8 * square, 0.2 * square, 0, 0}};
    if (random() % 2 == 0) {
      const dvec3 area = square * shift();
      points.planes[i] = {area, size * glm::length(area)};
    }
    if (random() % 8 != 0)
      points.value_moments[0][i] = {moments.mass,          moments.centroid, value,      value * value / 100,
                                    0.01 * size * shift(), value / 2,        1.5 * value};
  }
}

}  // namespace splatvol::test
