#include "builder/sources/mesh_data.h"

#include <gmock/gmock.h>

#include <numeric>

#include "builder/mesh/cell_kinds.h"
#include "builder/mesh/cell_moments.h"
#include "builder/sources/piece_maker.h"
#include "tests/support/results.h"

using namespace splatvol;
using testing::ElementsAre;

namespace {

/// A cell of order 2 that fills [0, 2]^3, or the half of it where x + y < 2. Its points stand in VTK's order.
MeshData quadratic_cell(int type, std::size_t count) {
  MeshData mesh;
  for (const dvec3& point : MeshDataSet(MeshData()).parametric_points(type, count)) mesh.points.push_back(2.0 * point);
  std::vector<std::int64_t> corners(count);
  std::iota(corners.begin(), corners.end(), 0);
  mesh.add_cell(type, corners);
  return mesh;
}

double volume_of(MeshData mesh) {
  const auto piece = test::value_of(make_piece("a mesh", MeshDataSet(std::move(mesh)), {}, CellValues::averaged, {}));
  double volume = 0;
  for (const auto& corners : piece->tetrahedra) volume += tetrahedron_volume(piece->points, corners);
  EXPECT_EQ(piece->census.inverted, 0);
  return volume;
}

TEST(MeshData, LatticesFillTheirCells) {
  EXPECT_DOUBLE_EQ(volume_of(quadratic_cell(vtk_cell::triquadratic_hexahedron, 27)), 8);
  EXPECT_DOUBLE_EQ(volume_of(quadratic_cell(vtk_cell::biquadratic_wedge, 18)), 4);
  EXPECT_TRUE(MeshDataSet(MeshData()).parametric_points(vtk_cell::triquadratic_hexahedron, 26).empty());
}

TEST(MeshData, ArraysOutliveTheirDataSet) {
  MeshData mesh;
  mesh.points.resize(2);
  mesh.arrays = {{{"v", 2, false, "m"}, {1, 2, 3, 4}}, {{"IBlank", 1, false}, {5, 6}}, {{"v", 1, false}, {7, 8}}};
  auto data = std::make_unique<MeshDataSet>(std::move(mesh));
  data->add_cell_values("v", {9});
  EXPECT_EQ(data->arrays().size(), 2) << "one at the points, one of cells, and no bookkeeping";
  const auto of_points = data->array("v", false), of_cells = data->array("v", true);
  EXPECT_FALSE(data->array("w", false));
  data = nullptr;
  EXPECT_THAT(component_values(**of_points, 0, 2), ElementsAre(7, 8)) << "the last of two of a name";
  EXPECT_THAT(component_values(**of_cells, 0, 1), ElementsAre(9));
}

}  // namespace
