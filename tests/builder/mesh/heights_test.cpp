#include "builder/mesh/heights.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "builder/mesh/tetrahedra.h"
#include "tests/builder/support/meshes.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

TEST(Heights, AreThreeVolumesOverTheLargestFace) {
  const double height = 1 / std::sqrt(3.0);  // of a corner of the unit cube over the triangle of its neighbours
  for (const double unit : {1.0, 1e-40, 1e45}) {
    const dvec3 x(unit, 0, 0), y(0, unit, 0), z(0, 0, unit);
    EXPECT_NEAR(least_height({}, x, y, z), height * unit, 1e-15 * unit);
    EXPECT_NEAR(least_height(z, y, {}, x), height * unit, 1e-15 * unit) << "in any order";
    EXPECT_NEAR(least_height({}, x, y, 1e-4 * z), 1e-4 * unit, 1e-8 * unit);
  }
}

TEST(Heights, OfFlatTetrahedraAreNone) {
  const dvec3 x(1, 0, 0), y(0, 1, 0);
  EXPECT_GT(least_height({}, x, y, {0.3, 0.3, 1.5e-6}), 0);
  EXPECT_EQ(least_height({}, x, y, {0.3, 0.3, 1.3e-6}), 0) << "the longest edge is the root of two";
  EXPECT_EQ(least_height({}, x, y, x + y), 0);
  EXPECT_EQ(least_height({}, x, y, x), 0);
  EXPECT_EQ(least_height(x, x, x, x), 0);
  EXPECT_EQ(least_height({}, x, y, dvec3(std::numeric_limits<double>::quiet_NaN())), 0);
  EXPECT_EQ(least_height({}, x, y, dvec3(std::numeric_limits<double>::infinity())), 0);
}

TEST(Heights, OfPointsAreTheLeastWithAnyNumberOfThreads) {
  const Mesh mesh = random_tetrahedra(20000);
  std::vector<Tetrahedron> tetrahedra;  // many at each of few points
  for (const Tetrahedron& corners : mesh.tetrahedra) tetrahedra.push_back(corners);
  for (Tetrahedron& corners : tetrahedra)
    for (std::uint32_t& corner : corners) corner = corner % 499;
  std::vector<double> expected(mesh.points.size(), no_height);
  for (const auto& [a, b, c, d] : tetrahedra) {
    const double height = least_height(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]);
    if (height > 0)
      for (const std::uint32_t corner : {a, b, c, d}) expected[corner] = std::min(expected[corner], height);
  }
  for (const std::size_t threads : {1u, 2u, 5u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    EXPECT_TRUE(least_heights(mesh.points, tetrahedra) == expected) << threads;
  }
  EXPECT_LT(expected[0], 1);
  EXPECT_EQ(expected.back(), no_height) << "no tetrahedron is there";
}

// The worst moves that the rule allows, of tetrahedra of any shape: each coordinate by all of the error.
TEST(Heights, LoseNoMoreThanA64thByRounding) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    std::array<dvec3, 4> corners, moved;
    for (dvec3& corner : corners) corner = random_vector(uniform, random);
    const double thin = std::pow(10, 2 * (uniform(random) - 1));
    for (dvec3& corner : corners) corner.z *= thin;
    const auto height_of = [](const std::array<dvec3, 4>& p) { return least_height(p[0], p[1], p[2], p[3]); };
    const auto volume_of = [](const std::array<dvec3, 4>& p) { return signed_volume_6(p[0], p[1], p[2], p[3]); };
    const double height = height_of(corners);
    if (height == 0) continue;
    for (int moves = 0; moves < 8; ++moves) {
      for (std::size_t k = 0; k < 4; ++k) {
        moved[k] = corners[k] + height * error_per_height * glm::sign(random_vector(uniform, random));
        EXPECT_LE(glm::length(moved[k] - corners[k]), height / 256 + 1e-15);
      }
      EXPECT_GT(volume_of(moved) * volume_of(corners), 0);
      worst = std::max(worst, 1 - height_of(moved) / height);
    }
  }
  EXPECT_LT(worst, 1.0 / 64);
  EXPECT_GT(worst, 1.0 / 200) << "the test has bad ones";
}

}  // namespace
}  // namespace splatvol::test
