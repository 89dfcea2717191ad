#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/scene.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TransferFunction with_jump() {
  TransferFunction function;
  function.lo = 10;
  function.hi = 20;
  function.colors = {{0.2, {1, 0, 0}}, {0.6, {0, 1, 2}}};
  function.densities = {{0, 1}, {0.5, 3}, {0.5, 8}, {1, 4}};
  return function;
}

TEST(TransferFunction, IsLinearBetweenControlPoints) {
  const auto function = with_jump();
  EXPECT_NEAR(function.extinction(12.5), 2, 1e-14);
  EXPECT_NEAR(function.extinction(17.5), 6, 1e-14);
  const dvec3 color = function.color(13);
  EXPECT_NEAR(color.r, 0.75, 1e-14);
  EXPECT_NEAR(color.g, 0.25, 1e-14);
  EXPECT_NEAR(color.b, 0.5, 1e-14);
}

TEST(TransferFunction, IsClampedOutside) {
  const auto function = with_jump();
  for (const double value : {-infinity, -1e9, 10.0, 11.0}) EXPECT_EQ(function.color(value), dvec3(1, 0, 0));
  for (const double value : {infinity, 1e9, 20.0, 16.0}) EXPECT_EQ(function.color(value), dvec3(0, 1, 2));
  EXPECT_EQ(function.extinction(-infinity), 1);
  EXPECT_EQ(function.extinction(infinity), 4);
}

TEST(TransferFunction, TakesTheLaterPointAtAJump) {
  const auto function = with_jump();
  EXPECT_EQ(function.extinction(15), 8);
  EXPECT_NEAR(function.extinction(std::nextafter(15.0, 0.0)), 3, 1e-12);
}

TEST(TransferFunction, IsNothingWhereTheValueIsMissing) {
  const auto function = with_jump();
  EXPECT_EQ(function.extinction(std::nan("")), 0);
  EXPECT_EQ(function.color(std::nan("")), dvec3(0));
}

TEST(TransferFunction, OnePointIsAConstant) {
  TransferFunction function;
  function.colors = {{0.5, {1, 2, 3}}};
  function.densities = {{1, 7}};
  for (const double value : {-1.0, 0.0, 0.5, 1.0, 2.0}) {
    EXPECT_EQ(function.color(value), dvec3(1, 2, 3));
    EXPECT_EQ(function.extinction(value), 7);
  }
}

TEST(TransferFunction, TableHoldsBothEnds) {
  const auto table = with_jump().table(5);
  ASSERT_EQ(table.size(), 5U);
  EXPECT_EQ(table.front(), vec4(1, 0, 0, 1));
  EXPECT_FLOAT_EQ(table[1].a, 2);
  EXPECT_FLOAT_EQ(table[2].a, 8);
  EXPECT_EQ(table.back(), vec4(0, 1, 2, 4));
}

}  // namespace
}  // namespace splatvol
