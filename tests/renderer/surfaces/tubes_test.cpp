// Tubes round lines.
#include "renderer/surfaces/tubes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

namespace splatvol {
namespace {

using testing::ElementsAre;

constexpr double none = std::numeric_limits<double>::quiet_NaN();

// A turn of a helix of radius 1.
std::vector<dvec3> helix(int rows) {
  std::vector<dvec3> positions;
  for (int i = 0; i < rows; ++i) {
    const double angle = 2 * std::numbers::pi * i / (rows - 1);
    positions.emplace_back(std::cos(angle), std::sin(angle), angle);
  }
  return positions;
}

double distance_from(const dvec3& a, const dvec3& b, const dvec3& position) {
  const double share = std::clamp(glm::dot(position - a, b - a) / squared_length(b - a), 0.0, 1.0);
  return glm::length(position - a - share * (b - a));
}

TEST(Thinned, LeavesOutWhatLiesOnTheLine) {
  const std::vector<dvec3> positions = helix(1001);
  const std::vector<std::size_t> rows = thinned(positions, {}, 0.01, 1);
  EXPECT_LT(rows.size(), 60);
  for (std::size_t i = 1; i < rows.size(); ++i)
    for (std::size_t row = rows[i - 1]; row <= rows[i]; ++row)
      EXPECT_LE(distance_from(positions[rows[i - 1]], positions[rows[i]], positions[row]), 0.01);
  const std::vector<dvec3> straight = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {4, 0, 0}};
  EXPECT_THAT(thinned(straight, {}, 1e-9, 1), ElementsAre(0, 3));
  EXPECT_THAT(thinned(straight, std::vector<double>{0, 1, 3, 4}, 1e-9, 0.1), ElementsAre(0, 3));
  EXPECT_THAT(thinned(straight, std::vector<double>{0, 2, 3.3, 4}, 1e-9, 0.1), ElementsAre(0, 1, 3));
  EXPECT_THAT(thinned(straight, std::vector<double>{0, none, none, 4}, 1e-9, 0.1), ElementsAre(0, 1, 3));
}

TEST(Tubes, AreClosedAndRoundTheirLine) {
  const std::vector<dvec3> positions = helix(101);
  const std::vector<std::size_t> rows = thinned(positions, {}, 0.01, 1);
  std::vector<double> values;
  for (const dvec3& p : positions) values.push_back(p.z);
  TubeMesh tubes;
  for (int tube = 0; tube < 2; ++tube) ASSERT_TRUE(add_tube(positions, values, rows, 0.1, tubes));
  const std::vector<dvec3>& points = tubes.mesh.points;
  const auto& triangles = tubes.mesh.triangles;
  ASSERT_EQ(tubes.values.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const std::size_t row : rows) nearest = std::min(nearest, glm::length(points[i] - positions[row]));
    EXPECT_NEAR(nearest, 0.1, 1e-12);
    EXPECT_NEAR(tubes.values[i], points[i].z, 0.1);
  }
  // Each edge has two triangles, which pass it in opposite directions.
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  double volume = 0;
  for (const auto& triangle : triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++edges[{triangle[k], triangle[(k + 1) % 3]}];
    const auto& [a, b, c] = triangle;
    volume += glm::dot(points[a], glm::cross(points[b], points[c])) / 6;
  }
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1);
    EXPECT_TRUE(edges.contains({edge.second, edge.first}));
  }
  const double length = 2 * std::numbers::pi * std::sqrt(2.0), disc = 0.01 * 5 * std::sin(std::numbers::pi / 5);
  EXPECT_NEAR(std::abs(volume), 2 * length * disc, 0.02 * length * disc);
}

// Also where a line turns back: each part is as wide as the tube.
TEST(Tubes, AreNeverFlat) {
  const std::vector<dvec3> positions = {{0, 0, 0}, {1, 0, 0}, {0, 0.01, 0}};
  TubeMesh tubes;
  ASSERT_TRUE(add_tube(positions, {}, std::vector<std::size_t>{0, 1, 2}, 0.1, tubes));
  for (const dvec3& p : tubes.mesh.points) {
    const double radius = std::hypot(p.y, p.z);
    EXPECT_NEAR(radius, 0.1, 0.011);
  }
}

}  // namespace
}  // namespace splatvol
