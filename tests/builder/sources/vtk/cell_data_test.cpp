// Arrays of cells: averaged to the points, and as cells that are points of their own.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/points/point_stream.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr int hexahedron = 12;

SourceOptions own_cells(std::vector<std::string> selection = {}) {
  return {.selection = std::move(selection), .cells = CellValues::own};
}

/// Boxes side by side along x, in y and z from 0 to 1, between these coordinates; and their arrays.
struct Boxes {
  std::vector<double> x;
  std::vector<VtkArray> point_data, cell_data;

  [[nodiscard]] std::string file() const {
    VtuMesh mesh{.point_data = point_data, .cell_data = cell_data};
    for (const double position : x)
      for (const auto& [y, z] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) mesh.points.emplace_back(position, y, z);
    for (int b = 0; b + 1 < static_cast<int>(x.size()); ++b) {
      mesh.cells.push_back({hexahedron, std::vector<int>(8)});
      std::iota(mesh.cells.back().points.begin(), mesh.cells.back().points.end(), 4 * b);
    }
    return mesh.file();
  }
};

/// The value of an attribute at the points with this x, all equal.
double value_at(const Input& input, const std::string& attribute, double x) {
  const std::size_t a = input.index_of(attribute);
  std::vector<double> values;
  for (const Piece& piece : input.pieces)
    for (std::size_t i = 0; i < piece.points.size(); ++i)
      if (std::abs(piece.points[i].x - x) < 1e-12) values.push_back(piece.values.at(a)[i]);
  EXPECT_FALSE(values.empty());
  EXPECT_EQ(std::ranges::count(values, values.at(0)) + (std::isnan(values.at(0)) ? std::ssize(values) : 0),
            std::ssize(values));
  return values.at(0);
}

std::vector<std::string> conversions(const std::string& path, const SourceOptions& options = {}) {
  auto source = value_of(open_source({path}, options));
  while (*source->next()) {
  }
  return source->conversions();
}

using CellDataTest = FolderTest;

TEST_F(CellDataTest, IsAveragedToPointsByVolume) {
  const std::string path =
      write("a.vtu", Boxes{{0, 1, 4, 6}, {}, {{"p", {2, 6, 6}}, {"U", {3, 0, 4, 1, 2, 2, 1, 2, 2}, 3}}}.file());
  const auto input = value_of(read_input({path}));
  EXPECT_THAT(input.attributes, ElementsAre("p", "U", "U[0]", "U[1]", "U[2]"));
  EXPECT_EQ(value_at(input, "p", 0), 2);
  EXPECT_DOUBLE_EQ(value_at(input, "p", 1), (1 * 2 + 3 * 6) / 4.0);
  EXPECT_EQ(value_at(input, "p", 4), 6) << "equal values stay the same to the last bit";
  EXPECT_DOUBLE_EQ(value_at(input, "U[0]", 1), (1 * 3 + 3 * 1) / 4.0);
  EXPECT_DOUBLE_EQ(value_at(input, "U", 1), std::hypot(1.5, 1.5, 2.5)) << "the magnitude of the mean";
  EXPECT_DOUBLE_EQ(input.volume, 6);
  EXPECT_THAT(conversions(path), ElementsAre("p, U: of cells, averaged to points"));
}

TEST_F(CellDataTest, LeavesMissingValuesOutOfMeans) {
  const std::string path =
      write("a.vtu", Boxes{{0, 1, 4, 6, 8}, {}, {{"p", {2, std::nan(""), std::nan(""), 1}}}}.file());
  const auto input = value_of(read_input({path}));
  EXPECT_EQ(value_at(input, "p", 1), 2);
  EXPECT_TRUE(std::isnan(value_at(input, "p", 4)));
  EXPECT_EQ(value_at(input, "p", 6), 1);
}

// All flags of a cell: as in VTK, those of a copy, of a cell that finer ones fill, and of a hidden one leave it out.
TEST_F(CellDataTest, OfAGhostCopyCountsAndOfAHiddenCellNot) {
  constexpr double duplicate = 1, high_connectivity = 2, low_connectivity = 4, refined = 8, exterior = 16, hidden = 32;
  struct Expected {
    double flags, mean;
    bool left_out;
  };
  for (const auto& [flags, mean, left_out] : {Expected{0, 5, false},
                                              {duplicate, 5, true},
                                              {high_connectivity, 5, false},
                                              {low_connectivity, 5, false},
                                              {refined, 2, true},
                                              {exterior, 5, false},
                                              {hidden, 2, true},
                                              {duplicate + refined, 2, true},
                                              {duplicate + hidden, 2, true},
                                              {high_connectivity + exterior, 5, false}})
    for (const char* type : {"UInt8", "Int32", "Float64"}) {
      const std::string path =
          write("a.vtu", Boxes{{0, 1, 4}, {}, {{"p", {2, 6}}, {"vtkGhostType", {0, flags}, 1, type}}}.file());
      const auto input = value_of(read_input({path}));
      EXPECT_EQ(value_at(input, "p", 1), mean) << flags;
      EXPECT_EQ(input.points, left_out ? 8u : 12u) << flags;
      EXPECT_DOUBLE_EQ(input.volume, left_out ? 1 : 4) << flags;
      EXPECT_EQ(input.census.hidden, left_out ? 1u : 0u) << flags;
      const auto own = value_of(read_input({path}, own_cells()));
      EXPECT_EQ(own.points, left_out ? 1u : 2u) << flags;
    }
}

/// Voxels of edge `spacing`, as VTK's writer of AMR meshes writes a block.
std::string image(int cells, double spacing, const std::vector<VtkArray>& cell_data) {
  const std::string extent = fmt::format("0 {0} 0 {0} 0 {0}", cells);
  return vtk_file("ImageData",
                  fmt::format("<Piece Extent=\"{}\"><CellData>\n{}</CellData></Piece>", extent, data_arrays(cell_data)),
                  fmt::format("WholeExtent=\"{0}\" Origin=\"0 0 0\" Spacing=\"{1} {1} {1}\"", extent, spacing));
}

// A block of 4 x 4 x 4 cells, of which another block fills the lowest octant with cells of half their size.
TEST_F(CellDataTest, OfCellsThatFinerOnesFillIsLeftOut) {
  std::vector<double> flags(64), coarse(64, 1);
  for (std::size_t cell = 0; cell < flags.size(); ++cell) {
    if (cell % 4 > 1 || cell / 4 % 4 > 1 || cell / 16 > 1) continue;
    flags[cell] = 8;
    coarse[cell] = 1000;
  }
  write("coarse.vti", image(4, 1, {{"p", coarse}, {"vtkGhostType", flags, 1, "UInt8"}}));
  write("fine.vti", image(4, 0.5, {{"p", std::vector<double>(64, 3)}}));
  const std::string blocks = write("amr.vtm", vtm_file({"coarse.vti", "fine.vti"}));
  for (const auto& inputs : {std::vector<std::string>{blocks}, {path("coarse.vti"), path("fine.vti")}}) {
    const auto input = value_of(read_input(inputs));
    EXPECT_NEAR(input.volume, 64, 1e-9);
    EXPECT_EQ(input.census.hidden, 8u);
    for (const double value : input.pieces.at(0).values.at(0)) EXPECT_EQ(value, 1);
    const auto own = value_of(read_input(inputs, own_cells()));
    EXPECT_EQ(own.points, 64u - 8 + 64);
  }
}

TEST_F(CellDataTest, OfALegacyFileHasFlagsToo) {
  for (const auto& [name, flags] :
       {std::pair{"vtkGhostType", "0 8"}, {"vtkGhostType", "0 32"}, {"vtkGhostLevels", "0 1"}})
    for (const char* version : {"3.0", "4.2"}) {
      const std::string path =
          write("a.vtk", legacy_file(fmt::format("STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n"
                                                 "CELL_DATA 2\nSCALARS p float 1\nLOOKUP_TABLE default\n2 6\n"
                                                 "SCALARS {} unsigned_char 1\nLOOKUP_TABLE default\n{}\n",
                                                 name, flags),
                                     version));
      const auto input = value_of(read_input({path}));
      EXPECT_DOUBLE_EQ(input.volume, 1) << name << flags;
      EXPECT_EQ(input.census.hidden, 1u) << name << flags;
      EXPECT_THAT(input.attributes, ElementsAre("p"));
    }
}

// Levels of older files: 0 for a cell or a point of this piece. VTK itself turns them into flags in old file versions.
TEST_F(CellDataTest, OfAGhostLevelIsThatOfACopy) {
  for (const char* version : {"0.1", "1.0", "2.0"})
    for (const char* type : {"UInt8", "Int32"}) {
      std::string file = Boxes{{0, 1, 4}, {}, {{"p", {2, 6}}, {"vtkGhostLevels", {0, 2}, 1, type}}}.file();
      const std::string path = write("a.vtu", file.replace(file.find("0.1"), 3, version));
      const auto input = value_of(read_input({path}));
      EXPECT_EQ(value_at(input, "p", 1), 5) << version << type;
      EXPECT_DOUBLE_EQ(input.volume, 1) << version << type;
      EXPECT_THAT(input.attributes, ElementsAre("p"));
    }
}

TEST_F(CellDataTest, TakesAnotherNameIfPointsHaveItsName) {
  const std::vector<double> at_points = {1, 1, 1, 1, 5, 5, 5, 5};
  const std::string path =
      write("a.vtu", Boxes{{0, 1}, {{"p", at_points}, {"U[1]", at_points}}, {{"U", {1, 2, 2}, 3}, {"p", {9}}}}.file());
  const auto input = value_of(read_input({path}));
  EXPECT_THAT(input.attributes,
              ElementsAre("p", "U[1]", "U (cells)", "U (cells)[0]", "U (cells)[1]", "U (cells)[2]", "p (cells)"));
  EXPECT_EQ(value_at(input, "p", 1), 5);
  EXPECT_EQ(value_at(input, "p (cells)", 1), 9);
  EXPECT_THAT(conversions(path), ElementsAre("U (cells), p (cells): of cells, averaged to points"));
  for (const char* name : {"p (cells)", "U (cells)[2]", "p"}) {
    const auto selected = value_of(read_input({path}, {{name}, {}}));
    EXPECT_THAT(selected.attributes, ElementsAre(name));
  }
  EXPECT_EQ(value_at(*read_input({path}, {{"p (cells)"}, {}}), "p (cells)", 0), 9);
  EXPECT_EQ(value_at(*read_input({path}, {{"p"}, {}}), "p", 0), 1);
  EXPECT_THAT(conversions(path, {{"p"}, {}}), IsEmpty());
  EXPECT_THAT(error_of({path}, {{"p (points)"}, {}}), HasSubstr("there are: p, U[1], U (cells)"));

  const auto own = value_of(read_input({path}, own_cells()));
  EXPECT_THAT(own.attributes, ElementsAre("U", "U[0]", "U[1]", "U[2]", "p", "p (points)", "U[1] (points)"));
  EXPECT_EQ(value_at(own, "p", 0.5), 9);
  EXPECT_DOUBLE_EQ(value_at(own, "p (points)", 0.5), 3);
}

TEST_F(CellDataTest, OwnCellsArePointsWithOneValue) {
  const std::string path =
      write("a.vtu",
            Boxes{{0, 1, 4, 4}, {{"z", {0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1}}}, {{"p", {2, 6, 8}}}}.file());
  const auto input = value_of(read_input({path}, own_cells()));
  ASSERT_EQ(input.pieces.size(), 1u);
  const Piece& piece = input.pieces[0];
  ASSERT_EQ(piece.points.size(), 2u) << "the third box is flat";
  EXPECT_EQ(input.census.left_out_flat, 1u);
  EXPECT_EQ(input.census.cells.at("hexahedron"), 3u);
  EXPECT_THAT(input.attributes, ElementsAre("p", "z"));
  EXPECT_THAT(piece.values[0], ElementsAre(2, 6));
  EXPECT_DOUBLE_EQ(piece.values[1][1], 0.5);
  EXPECT_LT(glm::length(piece.points[1] - dvec3(2.5, 0.5, 0.5)), 1e-15);
  EXPECT_TRUE(piece.tetrahedra.empty());
  ASSERT_TRUE(piece.cells);
  EXPECT_DOUBLE_EQ(piece.cells->moments[1].mass, 3);
  EXPECT_NEAR(piece.cells->moments[1].covariance.xx, 9.0 / 12, 1e-15);
  EXPECT_EQ(std::ranges::count(piece.cells->points, 0u), 6);
  EXPECT_EQ(std::ranges::count(piece.cells->points, PointCells::no_point), 6);
  EXPECT_THAT(conversions(path, own_cells()), ElementsAre("z: of points, averaged to cells"));
}

TEST_F(CellDataTest, OwnCellsNeedCells) {
  Boxes points{{0, 1, 2}, {{"s", {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}}}, {}};
  std::string file = points.file();
  for (std::size_t at = file.find("12 12"); at != std::string::npos; at = file.find("12 12"))
    file.replace(at, 5, "2 2");
  EXPECT_THAT(error_of({write("a.vtu", file)}, own_cells()), HasSubstr("no cells with a volume"));
  EXPECT_THAT(error_of({"gen:mesh:cells=100"}, own_cells()), AllOf(HasSubstr("gen:mesh"), HasSubstr("--cells own")));
}

/// Planes of the points of an input in these files, by the points' x.
std::vector<std::pair<double, BoundaryPlane>> planes_of(const std::vector<std::string>& paths) {
  auto source = value_of(open_source(paths, own_cells()));
  auto points = value_of(PointStream::create(*source, true, std::size_t{1} << 24, ::testing::TempDir(), [](double) {}));
  PointBatch batch;
  batch.resize_attributes(source->attributes().size());
  while (*points.next(batch)) {
  }
  std::vector<std::pair<double, BoundaryPlane>> planes;
  for (std::size_t i = 0; i < batch.size(); ++i) planes.emplace_back(batch.positions[i].x, batch.planes.at(i));
  std::ranges::sort(planes, {}, [](const auto& plane) { return plane.first; });
  return planes;
}

// Boxes as wide as they are high, so that the plane of a box at an end of the row is that of the end or of a side.
TEST_F(CellDataTest, OwnCellsHaveNoPlaneWhereCellsTouch) {
  const std::string whole = write("whole.vtu", Boxes{{0, 0.25, 0.5, 0.75, 1}, {}, {{"p", {1, 2, 3, 4}}}}.file());
  const std::string left = write("left.vtu", Boxes{{0, 0.25, 0.5}, {}, {{"p", {1, 2}}}}.file());
  const std::string right = write("right.vtu", Boxes{{0.5, 0.75, 1}, {}, {{"p", {3, 4}}}}.file());
  const auto expected = planes_of({whole}), pieces = planes_of({left, right});
  ASSERT_EQ(expected.size(), 4u);
  ASSERT_EQ(pieces.size(), 4u);
  for (const auto& planes : {expected, pieces}) {
    EXPECT_NEAR(std::abs(planes[0].second.area.x), 1, 1e-14) << "an end has the largest area";
    EXPECT_NEAR(planes[0].second.offset, 0.125, 1e-14);
    EXPECT_NEAR(planes[3].second.area.x, 1, 1e-14);
    for (const std::size_t inner : {1u, 2u}) {
      EXPECT_EQ(planes[inner].second.area.x, 0);
      EXPECT_NEAR(glm::length(planes[inner].second.area), 0.25, 1e-14);
      EXPECT_NEAR(planes[inner].second.offset, 0.25 * 0.5, 1e-14);
    }
  }
}

TEST_F(CellDataTest, FilesOfOwnCellsHoldConstantCells) {
  std::vector<double> x(40), values(39);
  std::iota(x.begin(), x.end(), 0.0);
  std::iota(values.begin(), values.end(), 1.0);
  values[7] = std::nan("");
  auto source = value_of(open_source({write("a.vtu", Boxes{x, {}, {{"p", values}}}.file())}, own_cells()));
  const auto report = value_of(build_volume(*source, path("out.svol"), {}, [](const char*, double) {}));
  EXPECT_EQ(report.resolution_counts.back(), 39u);
  EXPECT_EQ(report.connectivity, Connectivity::mesh);
  EXPECT_EQ(report.missing.at(0).second, 1u);
  EXPECT_EQ(report.points.merged, 0u);
}

// A mesh without values has those of its cells: volumes, or numbers of blocks.
TEST_F(CellDataTest, OfAMeshWithoutValuesAreMade) {
  write("a.vti", image(2, 1, {}));
  write("b.vti", image(4, 0.5, {}));
  for (const CellValues cells : {CellValues::averaged, CellValues::own}) {
    const auto volumes = value_of(read_input({path("b.vti")}, {.cells = cells}));
    EXPECT_THAT(volumes.attributes, ElementsAre("cell_volume"));
    EXPECT_EQ(volumes.points, cells == CellValues::own ? 64u : 125u);
    for (const double value : volumes.pieces.at(0).values.at(0)) EXPECT_DOUBLE_EQ(value, 0.125);
  }
  const std::string blocks = write("all.vtm", vtm_file({"a.vti", "b.vti"}));
  for (const auto& selection : {std::vector<std::string>{}, {"block"}}) {
    const auto numbers = value_of(read_input({blocks}, {.selection = selection}));
    EXPECT_THAT(numbers.attributes, ElementsAre("block"));
    EXPECT_EQ(numbers.points, 8u + 64);
    ASSERT_EQ(numbers.pieces.size(), 2u);
    EXPECT_THAT(numbers.pieces[0].values.at(0), Each(1.0));
    EXPECT_THAT(numbers.pieces[1].values.at(0), Each(2.0));
  }
  EXPECT_THAT(message_of(read_input({blocks}, {.selection = {"p"}})), HasSubstr("there are: block"));
  // If one of them has values, these are the attributes.
  write("b.vti", image(4, 0.5, {{"p", std::vector<double>(64, 3)}}));
  EXPECT_THAT(value_of(read_input({blocks})).attributes, ElementsAre("p"));
}

}  // namespace
}  // namespace splatvol::test
