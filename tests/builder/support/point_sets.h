// Points for the builder's tests.
#pragma once

#include <algorithm>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/sorting/morton.h"
#include "tests/support/random.h"

namespace splatvol::test {

inline constexpr Cube unit_cube{{0, 0, 0}, 1};

/// Points of the unit cube in Morton order.
struct Sorted {
  std::vector<dvec3> positions;
  std::vector<MortonKey> keys;
};

inline Sorted sort_points(std::vector<dvec3> positions) {
  std::ranges::stable_sort(positions, {}, [](const dvec3& p) { return morton_key(p, unit_cube); });
  Sorted sorted{std::move(positions), {}};
  for (const dvec3& p : sorted.positions) sorted.keys.push_back(morton_key(p, unit_cube));
  return sorted;
}

/// A lattice of n.x x n.y x n.z points.
inline std::vector<dvec3> lattice_points(const glm::ivec3& n, const dvec3& spacing = dvec3(1),
                                         const dvec3& origin = dvec3(0)) {
  std::vector<dvec3> points;
  for (int k = 0; k < n.z; ++k)
    for (int j = 0; j < n.y; ++j)
      for (int i = 0; i < n.x; ++i) points.push_back(origin + spacing * dvec3(i, j, k));
  return points;
}

inline double total_mass(std::span<const SpatialMoments> moments) {
  double sum = 0;
  for (const SpatialMoments& m : moments) sum += m.mass;
  return sum;
}

/// Uniform in the unit cube.
inline std::vector<dvec3> uniform_points(int count, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit;
  std::vector<dvec3> points;
  for (int i = 0; i < count; ++i) points.push_back(random_vector(unit, random));
  return points;
}

}  // namespace splatvol::test
