// Edits of a transfer function by a hand.
#include "scene/transfer_edits.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

using Density = TransferFunction::Density;

TEST(TransferEdits, PointsStayInOrder) {
  std::vector<Density> points = {{0, 1}, {0.5, 2}, {0.5, 3}, {1, 4}};
  EXPECT_EQ(add_point(points, {0.5, 5}), 3U) << "behind those of the same t";
  EXPECT_EQ(add_point(points, {0, 6}), 1U);
  EXPECT_EQ(add_point(points, {1, 7}), 6U);
  move_point(points, 2, 0.2);
  EXPECT_EQ(points[2], (Density{0.2, 2}));
  move_point(points, 2, 0.9);
  EXPECT_EQ(points[2].t, 0.5) << "not past the next one";
  move_point(points, 2, -1);
  EXPECT_EQ(points[2].t, 0) << "not past the one before";
  move_point(points, 6, 3);
  EXPECT_EQ(points[6].t, 1);
  EXPECT_TRUE(std::ranges::is_sorted(points, {}, &Density::t));
}

TEST(TransferEdits, APointStays) {
  std::vector<Density> points = {{0.2, 1}, {0.5, 2}};
  remove_point(points, 0);
  EXPECT_EQ(points, (std::vector<Density>{{0.5, 2}}));
  remove_point(points, 0);
  EXPECT_EQ(points.size(), 1U);
}

TEST(TransferEdits, AnotherAxisTakesAValidDomain) {
  TransferFunction function{.lo = -2, .hi = 100, .colors = {{0, dvec3(0)}}, .densities = {{0, 1}, {0.3, 7}, {1, 2}}};
  EXPECT_EQ(largest_extinction(function), 7);
  const TransferFunction log = with_domain(function, ValueAxis::log, -2, 100);
  EXPECT_EQ(log.axis, ValueAxis::log);
  EXPECT_DOUBLE_EQ(log.lo, 1e-4);
  EXPECT_EQ(log.hi, 100);
  EXPECT_EQ(log.densities, function.densities);
  EXPECT_EQ(with_domain(function, ValueAxis::log, 3, 4).lo, 3);
  EXPECT_EQ(with_domain(function, ValueAxis::log, -2, 0), function) << "no logarithms there";
  TransferFunction asinh = with_domain(function, ValueAxis::asinh, -200, 100);
  EXPECT_DOUBLE_EQ(asinh.linear_width, 0.2);
  asinh.linear_width = 5;
  EXPECT_EQ(with_domain(asinh, ValueAxis::asinh, -1, 1).linear_width, 5) << "that of the hand stays";
}

}  // namespace
}  // namespace splatvol
