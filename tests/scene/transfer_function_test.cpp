#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/transfer_function.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

TransferFunction with_jump() {
  return {.lo = 10,
          .hi = 20,
          .colors = {{0.2, {1, 0, 0}}, {0.6, {0, 1, 2}}},
          .densities = {{0, 1}, {0.5, 3}, {0.5, 8}, {1, 4}}};
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

TEST(TransferFunction, TakesTheOuterPointOfAJumpAtAnEnd) {
  auto function = with_jump();
  function.densities = {{0, 7}, {0, 1}, {1, 4}, {1, 9}};
  function.colors = {{0, {1, 0, 0}}, {0, {0, 1, 0}}, {1, {0, 0, 1}}, {1, {1, 1, 0}}};
  for (const double value : {-infinity, -1e9, std::nextafter(10.0, 0.0)}) {
    EXPECT_EQ(function.extinction(value), 7);
    EXPECT_EQ(function.color(value), dvec3(1, 0, 0));
  }
  EXPECT_EQ(function.extinction(10), 1);
  EXPECT_EQ(function.color(10), dvec3(0, 1, 0));
  EXPECT_NEAR(function.extinction(std::nextafter(20.0, 0.0)), 4, 1e-12);
  for (const double value : {20.0, 1e9, infinity}) {
    EXPECT_EQ(function.extinction(value), 9);
    EXPECT_EQ(function.color(value), dvec3(1, 1, 0));
  }
}

TEST(TransferFunction, IsNothingWhereTheValueIsMissing) {
  const auto function = with_jump();
  EXPECT_EQ(function.extinction(std::nan("")), 0);
  EXPECT_EQ(function.color(std::nan("")), dvec3(0));
}

TEST(TransferFunction, OnePointIsAConstant) {
  TransferFunction function{.colors = {{0.5, {1, 2, 3}}}, .densities = {{1, 7}}};
  for (const double value : {-1.0, 0.0, 0.5, 1.0, 2.0}) {
    EXPECT_EQ(function.color(value), dvec3(1, 2, 3));
    EXPECT_EQ(function.extinction(value), 7);
  }
}

TEST(TransferFunction, AFactorIsOnAllDensities) {
  auto scaled = with_jump();
  scaled.density_factor = 2.5;
  for (const double value : {5.0, 11.0, 15.0, 18.0, 30.0})
    EXPECT_EQ(scaled.extinction(value), 2.5 * with_jump().extinction(value));
  EXPECT_EQ(scaled.color(13), with_jump().color(13));
  const auto pieces = linear_pieces(scaled), before = linear_pieces(with_jump());
  ASSERT_EQ(pieces.size(), before.size());
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    EXPECT_EQ(pieces[i].at_begin[3], 2.5 * before[i].at_begin[3]);
    EXPECT_EQ(pieces[i].at_end[3], 2.5 * before[i].at_end[3]);
  }
}

TEST(TransferFunction, PiecesEndAtBendsAndJumps) {
  const TransferFunction function = with_jump();
  EXPECT_EQ(bends(function), (std::vector<double>{0, 0.2, 0.5, 0.6, 1}));
  const std::vector<LinearPiece> pieces = linear_pieces(function);
  ASSERT_EQ(pieces.size(), 4U);
  EXPECT_EQ(pieces[0].begin, 0);
  EXPECT_EQ(pieces[0].at_begin, glm::dvec4(1, 0, 0, 1));
  EXPECT_EQ(pieces[1].end, 0.5);
  EXPECT_LT(glm::distance(pieces[1].at_end, glm::dvec4(0.25, 0.75, 1.5, 3)), 1e-14);
  EXPECT_EQ(pieces[2].begin, 0.5);
  EXPECT_LT(glm::distance(pieces[2].at_begin, glm::dvec4(0.25, 0.75, 1.5, 8)), 1e-14);
  EXPECT_EQ(pieces[3].end, 1);
  EXPECT_EQ(pieces[3].at_end, glm::dvec4(0, 1, 2, 4));
}

TransferFunction on_axis(ValueAxis axis, double lo, double hi) {
  TransferFunction function;
  function.lo = lo, function.hi = hi;
  function.axis = axis;
  function.linear_width = 1e-2;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 1}, {1, 3}};
  return function;
}

TEST(ValueAxis, EqualRatiosAreEqualStepsOfALogarithmicAxis) {
  const auto function = on_axis(ValueAxis::log, 1e-6, 1e3);
  for (int decade = 0; decade <= 9; ++decade) {
    const double value = 1e-6 * std::pow(10, decade);
    EXPECT_NEAR(function.t_of(value), decade / 9.0, 1e-14);
    EXPECT_NEAR(function.value_at(decade / 9.0) / value, 1, 1e-13);
    EXPECT_NEAR(function.extinction(value), 1 + 2 * decade / 9.0, 1e-13);
  }
  EXPECT_EQ(function.value_at(0), 1e-6);
  EXPECT_EQ(function.value_at(1), 1e3);
}

TEST(ValueAxis, ZeroAndNegativeValuesCountAsTheLowEndOfALogarithmicAxis) {
  const auto function = on_axis(ValueAxis::log, 1e-6, 1e3);
  for (const double value : {0.0, -0.0, -1.0, -1e100, -infinity, 1e-300}) EXPECT_EQ(function.extinction(value), 1);
  EXPECT_EQ(function.extinction(infinity), 3);
  EXPECT_EQ(function.extinction(std::nan("")), 0);
}

TEST(ValueAxis, AsinhShowsBothSignsAlike) {
  const auto function = on_axis(ValueAxis::asinh, -1e3, 1e3);
  EXPECT_NEAR(function.t_of(0), 0.5, 1e-14);
  for (const double value : {1e-9, 1e-3, 1.0, 500.0}) {
    EXPECT_NEAR(function.t_of(value) + function.t_of(-value), 1, 1e-14);
    EXPECT_NEAR(function.value_at(function.t_of(value)) / value, 1, 1e-6);
  }
  // Linear far below the width, logarithmic far above.
  EXPECT_NEAR((function.t_of(2e-5) - 0.5) / (function.t_of(1e-5) - 0.5), 2, 1e-5);
  EXPECT_NEAR(function.t_of(1000) - function.t_of(100), function.t_of(100) - function.t_of(10), 1e-5);
}

TEST(ValueAxis, MomentsAreThoseOfTheDistribution) {
  auto function = on_axis(ValueAxis::linear, 2, 6);
  EXPECT_DOUBLE_EQ(function.moments_of(3, 1).mean, 0.25);
  EXPECT_DOUBLE_EQ(function.moments_of(3, 1).deviation, 0.25);

  // Mean and deviation of a lognormal distribution whose logarithm has the mean 1 and the deviation 0.8.
  function = on_axis(ValueAxis::log, 1, std::exp(10));
  const double variance = 0.64, mean = std::exp(1 + variance / 2);
  const AxisMoments log = function.moments_of(mean, mean * std::sqrt(std::expm1(variance)));
  EXPECT_NEAR(log.mean, 0.1, 1e-13);
  EXPECT_NEAR(log.deviation, 0.08, 1e-13);
  EXPECT_LT(function.moments_of(-1, 5).mean, 0);

  function = on_axis(ValueAxis::asinh, -1e3, 1e3);
  const AxisMoments narrow = function.moments_of(10, 1e-3);
  EXPECT_NEAR(narrow.mean, function.t_of(10), 1e-9);
  EXPECT_NEAR(narrow.deviation, (function.t_of(10.001) - function.t_of(9.999)) / 2, 1e-9);
  EXPECT_NEAR(function.moments_of(0, 1e3).mean, 0.5, 1e-14);
}

}  // namespace
}  // namespace splatvol
