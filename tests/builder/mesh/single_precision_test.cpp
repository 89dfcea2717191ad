#include "builder/mesh/single_precision.h"

#include <gtest/gtest.h>

#include <vector>

namespace splatvol {
namespace {

CellCensus measure(std::vector<dvec3> points) {
  for (dvec3& p : points)
    for (int axis = 0; axis < 3; ++axis) p[axis] = static_cast<float>(p[axis]);
  CellCensus census;
  measure_single_precision(points, std::vector<Tetrahedron>{{0, 1, 2, 3}}, census);
  return census;
}

/// A tetrahedron with its right angle at `corner`.
std::vector<dvec3> tetrahedron(dvec3 corner, dvec3 edges) {
  return {corner, corner + dvec3(edges.x, 0, 0), corner + dvec3(0, edges.y, 0), corner + dvec3(0, 0, edges.z)};
}

TEST(SinglePrecision, BendsACellWhoseHeightIsLessThan64Moves) {
  // Steps are 1/2 in y. The lower face at y moves by a quarter, the slanted one by a bit less.
  const dvec3 far(0, 5e6, 0);
  for (const auto& [height, bent] : {std::pair{64.0 / 4 - 1, true}, {64.0 / 4 + 1, false}}) {
    const CellCensus census = measure(tetrahedron(far, {1e6, height, 1e6}));
    EXPECT_EQ(census.bent, bent ? 1u : 0u) << height;
    EXPECT_NEAR(census.measured_volume, 1e12 * height / 6, 1e-3);
    EXPECT_EQ(census.bent_volume, bent ? census.measured_volume : 0);
  }
  // A thin cell along the axis whose steps are large does not bend: they hardly move its faces across it.
  EXPECT_EQ(measure(tetrahedron(far, {1e-3, 1e6, 1e-3})).bent, 0u);
  EXPECT_EQ(measure(tetrahedron({0, 0, 0}, {1e-3, 1, 1})).bent, 0u);
  EXPECT_EQ(measure(tetrahedron({1, 0, 0}, {1e-6, 1, 1})).bent, 1u);
}

// Cells that are small beside the steps, but none that was flat in the input.
TEST(SinglePrecision, FlattensCellsThatAreSmallBesideItsSteps) {
  EXPECT_EQ(measure(tetrahedron({5e5, 4.5e6, 0}, {0.2, 0.2, 0.2})).flattened, 1u);
  EXPECT_EQ(measure(tetrahedron({5e5, 4.5e6, 0}, {1000, 0, 1000})).flattened, 0u);
  const CellCensus flat = measure(tetrahedron({0, 0, 0}, {1, 1, 0}));
  EXPECT_EQ(flat.flattened + flat.bent, 0u);
  EXPECT_EQ(flat.measured_volume, 0);
}

}  // namespace
}  // namespace splatvol
