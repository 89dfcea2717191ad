#include "streamer/decode.h"
#include "tests/support/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace splatvol {
namespace {

glm::dquat random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return glm::normalize(test::random_quaternion(normal, random));
}

// Returns the rotation that the three numbers of a MomentsSplat describe.
dmat3 axes_of(const vec3& orientation) {
  const dvec3 v(orientation);
  return glm::mat3_cast(glm::dquat(std::sqrt(1 - glm::dot(v, v)), v.x, v.y, v.z));
}

TEST(Compact, KeepsThePrincipalAxesUpToTheSignsThatItNames) {
  std::mt19937 random(1);
  std::array<int, 4> turned{};
  for (int trial = 0; trial < 2000; ++trial) {
    const glm::dquat q = random_rotation(random);
    const MaterialShape shape = compact(format::SplatShape{2.5, dvec3(3, 2, 1), q, dvec3(1, -2, 3.5), 2});
    EXPECT_EQ(shape.mass, 5.0f) << "times the density";
    EXPECT_EQ(shape.deviations, vec3(3, 2, 1));
    const dvec3 v(shape.orientation);
    ASSERT_LE(glm::dot(v, v), 0.75 + 1e-6) << "w >= 1/2";
    ASSERT_LE(shape.turned, 3u);
    ++turned[shape.turned];
    const dmat3 before = glm::mat3_cast(q), after = axes_of(shape.orientation);
    for (int k = 0; k < 3; ++k) {
      const bool reversed = shape.turned < 3 && static_cast<std::uint32_t>(k) != shape.turned;
      // The error of products of two components up to 1 in single precision.
      ASSERT_LT(glm::length(after[k] - (reversed ? -1.0 : 1.0) * before[k]), 1e-6) << "axis " << k;
      // The foot on the boundary stays where it is.
      const int code = static_cast<int>(shape.boundary << (22 - 10 * k)) >> 22;
      ASSERT_EQ(code / 128.0, (reversed ? -1.0 : 1.0) * dvec3(1, -2, 3.5)[k]) << "axis " << k;
    }
  }
  for (const int count : turned) EXPECT_GT(count, 300) << "each of q's components is the largest now and then";
}

TEST(Compact, TakesTurnsThatLeaveNothingForW) {
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      dvec3 v(0);
      v[axis] = sign;
      const MaterialShape shape = compact(format::SplatShape{1, dvec3(1), glm::dquat(0.0, v.x, v.y, v.z)});
      EXPECT_EQ(shape.orientation, vec3(0));
      EXPECT_EQ(shape.turned, static_cast<std::uint32_t>(axis));
    }
}

TEST(Compact, RoundsCorrelationsToBytes) {
  const MaterialValue value = compact(format::SplatValue{7, 2, dvec3(-1, 0.5, 0), 1, 0.25});
  EXPECT_EQ(value.mean, 7);
  EXPECT_EQ(value.deviation, 2);
  EXPECT_EQ(value.correlations, (std::array<std::int8_t, 4>{-127, 64, 0, 127}));
  EXPECT_EQ(value.coverage, 0.25f);
}

TEST(Compact, WithoutAValueNothingElseMeansAnything) {
  const MaterialValue value = compact(format::SplatValue{NAN, 1e300, dvec3(NAN), 5, 0});
  EXPECT_EQ(value.mean, 0);
  EXPECT_EQ(value.deviation, 0);
  EXPECT_EQ(value.correlations, (std::array<std::int8_t, 4>{}));
  EXPECT_EQ(value.coverage, 0);
}

}  // namespace
}  // namespace splatvol
