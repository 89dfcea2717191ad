// The material of whole cells, against closed forms.
#include "builder/mesh/cell_moments.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/builder/support/meshes.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(CellMoments, OfABoxAreExactFarFromTheOriginToo) {
  const dvec3 far(1e6, -3e6, 2e6), edges(1, 2, 4);
  Mesh box = lattice(1, [&](dvec3 p) { return far + edges * p; });
  std::swap(box.tetrahedra[2][0], box.tetrahedra[2][1]);  // volumes are absolute
  const CellMoments cell = cell_moments(box.points, box.tetrahedra);
  EXPECT_NEAR(cell.moments.mass, 8, 1e-14);
  EXPECT_LT(glm::length(cell.centroid - (far + edges / 2.0)), 1e-9);
  const SymmetricMatrix& covariance = cell.moments.covariance;
  EXPECT_NEAR(covariance.xx, 1.0 / 12, 1e-9);
  EXPECT_NEAR(covariance.yy, 4.0 / 12, 1e-9);
  EXPECT_NEAR(covariance.zz, 16.0 / 12, 1e-9);
  EXPECT_NEAR(std::abs(covariance.xy) + std::abs(covariance.xz) + std::abs(covariance.yz), 0, 1e-8);
}

// The unit tetrahedron: volume 1/6, mean 1/4, and variance 3/80 and covariance -1/80 of the coordinates.
TEST(CellMoments, OfATetrahedronAreItsClosedForm) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::vector<Tetrahedron> tetrahedra = {{0, 1, 2, 3}};
  const CellMoments cell = cell_moments(points, tetrahedra);
  EXPECT_DOUBLE_EQ(cell.moments.mass, 1.0 / 6);
  EXPECT_DOUBLE_EQ(cell.centroid.y, 0.25);
  EXPECT_DOUBLE_EQ(cell.moments.covariance.zz, 3.0 / 80);
  EXPECT_DOUBLE_EQ(cell.moments.covariance.xz, -1.0 / 80);
}

TEST(CellMoments, OfFlatCellsAreNone) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  const std::vector<Tetrahedron> tetrahedra = {{0, 1, 2, 3}};
  EXPECT_EQ(cell_moments(points, tetrahedra).moments.mass, 0);
  EXPECT_EQ(cell_moments(points, {}).moments.mass, 0);
  EXPECT_TRUE(std::isnan(cell_mean(points, tetrahedra, std::vector<double>{1, 2, 3, 4})));
}

TEST(CellMean, OfALinearFieldIsItsValueAtTheCentroid) {
  const Mesh mesh = jittered(2, 0.3);
  std::vector<double> values;
  for (const dvec3& p : mesh.points) values.push_back(3 + p.x - 2 * p.y + p.z);
  const dvec3 c = cell_moments(mesh.points, mesh.tetrahedra).centroid;
  EXPECT_NEAR(cell_mean(mesh.points, mesh.tetrahedra, values), 3 + c.x - 2 * c.y + c.z, 1e-13);
}

TEST(CellMean, LeavesOutTetrahedraWithAMissingValue) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -1}};
  const std::vector<Tetrahedron> tetrahedra = {{0, 1, 2, 3}, {0, 1, 2, 4}};
  EXPECT_DOUBLE_EQ(cell_mean(points, tetrahedra, std::vector<double>{1, 2, 3, nan, 6}), 3);
  EXPECT_TRUE(std::isnan(cell_mean(points, tetrahedra, std::vector<double>{nan, 2, 3, 4, 6})));
}

}  // namespace
}  // namespace splatvol::test
