// Positions in a tetrahedron.
#include "sampler/tetrahedron.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/support/random.h"

namespace splatvol::test {
namespace {

dvec3 point_at(const TetrahedronCorners& corners, const CornerWeights& weights) {
  dvec3 sum(0);
  for (std::size_t k = 0; k < 4; ++k) sum += weights[k] * corners[k];
  return sum;
}

struct InATetrahedron : ::testing::Test {
  dvec3 random_point() { return random_vector(uniform_, random_); }
  TetrahedronCorners random_corners() { return {random_point(), random_point(), random_point(), random_point()}; }

  std::mt19937_64 random_{3};
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

TEST_F(InATetrahedron, WeightsAreThoseOfThePosition) {
  int inside = 0;
  for (int i = 0; i < 2000; ++i) {
    const TetrahedronCorners corners = random_corners();
    const dvec3 position = 0.3 * random_point();
    const auto weights = weights_in(corners, position);
    if (!weights) continue;
    ++inside;
    EXPECT_NEAR(glm::length(point_at(corners, *weights) - position), 0, 1e-12);
  }
  EXPECT_GT(inside, 50);
}

TEST_F(InATetrahedron, ACornerHasAllWeight) {
  for (int i = 0; i < 100; ++i) {
    const TetrahedronCorners corners = random_corners();
    for (std::size_t k = 0; k < 4; ++k) {
      CornerWeights expected{};
      expected[k] = 1;
      EXPECT_EQ(weights_in(corners, corners[k]), expected);
    }
  }
}

// Two tetrahedra on both sides of a face: whatever is rounded, a position on the face is in one of them.
TEST_F(InATetrahedron, NoGapOpensBetweenTwo) {
  for (int i = 0; i < 5000; ++i) {
    const dvec3 a = random_point(), b = random_point(), c = random_point();
    const dvec3 normal = glm::cross(b - a, c - a), middle = (a + b + c) / 3.0;
    const dvec3 on = 0.3 * a + 0.3 * b + 0.4 * c;
    EXPECT_TRUE(weights_in({middle + normal, a, b, c}, on) || weights_in({a, b, c, middle - normal}, on)) << i;
  }
}

TEST_F(InATetrahedron, TheNearestPointIsNoFartherThanAnyOther) {
  for (int i = 0; i < 300; ++i) {
    TetrahedronCorners corners = random_corners();
    if (i % 3 == 0) corners[3] = corners[0] + 0.5 * (corners[1] - corners[2]);  // flat
    const dvec3 position = 3.0 * random_point();
    const auto nearest = nearest_on(corners, position, 100);
    ASSERT_TRUE(nearest);
    const dvec3 at = point_at(corners, nearest->weights);
    EXPECT_NEAR(glm::length(at - position), nearest->distance, 1e-12);
    EXPECT_NEAR(nearest->weights[0] + nearest->weights[1] + nearest->weights[2] + nearest->weights[3], 1, 1e-12);
    EXPECT_GE(std::ranges::min(nearest->weights), 0);
    // The plane through it, across the way to the position, has all corners behind it.
    EXPECT_FALSE(nearest_on(corners, position, 0.999 * nearest->distance));
    if (weights_in(corners, position)) continue;
    for (const dvec3& corner : corners) EXPECT_LE(glm::dot(corner - at, position - at), 1e-9);
  }
}

}  // namespace
}  // namespace splatvol::test
