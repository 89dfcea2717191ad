#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/transfer_function.h"

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

}  // namespace
}  // namespace splatvol
