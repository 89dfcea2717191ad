// Arrays of cells: averaged to the points, and as cells that are points of their own.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "builder/build.h"
#include "builder/open_source.h"
#include "builder/points/point_stream.h"
#include "tests/builder/sources/folder_test.h"
#include "tests/builder/sources/read_input.h"

namespace splatvol {
namespace {

using test::error_of;
using test::Input;
using test::read_input;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int hexahedron = 12;

SourceOptions own_cells(std::vector<std::string> selection = {}) {
  SourceOptions options;
  options.selection = std::move(selection);
  options.cells = CellValues::own;
  return options;
}

std::string join(const std::vector<double>& values) {
  std::string text;
  for (const double value : values) text += fmt::format("{} ", value);
  return text;
}

std::string array(const std::string& name, const std::vector<double>& values, int components = 1,
                  const char* type = "Float64") {
  return fmt::format("<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"ascii\">{}</DataArray>\n",
                     type, name, components, join(values));
}

/// Boxes side by side along x, in y and z from 0 to 1, between these coordinates; and their arrays.
struct Boxes {
  std::vector<double> x;
  std::string point_data, cell_data;

  [[nodiscard]] std::string file() const {
    std::vector<double> points, connectivity, offsets, types;
    for (const double position : x)
      for (const auto& [y, z] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}})
        points.insert(points.end(), {position, static_cast<double>(y), static_cast<double>(z)});
    const auto boxes = static_cast<int>(x.size()) - 1;
    for (int b = 0; b < boxes; ++b) {
      for (int i = 0; i < 8; ++i) connectivity.push_back(4 * b + i);
      offsets.push_back(8 * (b + 1));
      types.push_back(hexahedron);
    }
    return fmt::format(
               "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"><UnstructuredGrid>\n"
               "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\"><PointData>\n",
               4 * x.size(), boxes) +
           point_data + "</PointData><CellData>\n" + cell_data + "</CellData><Points>\n" + array("Points", points, 3) +
           "</Points><Cells>\n" + array("connectivity", connectivity, 1, "Int64") +
           array("offsets", offsets, 1, "Int64") + array("types", types, 1, "UInt8") +
           "</Cells></Piece></UnstructuredGrid></VTKFile>\n";
  }
};

/// The value of an attribute at the points with this x, all equal.
double value_at(const Input& input, const std::string& attribute, double x) {
  const auto a = static_cast<std::size_t>(std::ranges::find(input.attributes, attribute) - input.attributes.begin());
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
  auto source = open_source({path}, options);
  EXPECT_TRUE(source) << source.error().message;
  while (*(*source)->next()) {
  }
  return (*source)->conversions();
}

using CellDataTest = test::FolderTest;

TEST_F(CellDataTest, IsAveragedToPointsByVolume) {
  const std::string path = write(
      "a.vtu", Boxes{{0, 1, 4, 6}, "", array("p", {2, 6, 6}) + array("U", {3, 0, 4, 1, 2, 2, 1, 2, 2}, 3)}.file());
  const auto input = read_input({path});
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_THAT(input->attributes, ElementsAre("p", "U", "U[0]", "U[1]", "U[2]"));
  EXPECT_EQ(value_at(*input, "p", 0), 2);
  EXPECT_DOUBLE_EQ(value_at(*input, "p", 1), (1 * 2 + 3 * 6) / 4.0);
  EXPECT_EQ(value_at(*input, "p", 4), 6) << "equal values stay the same to the last bit";
  EXPECT_DOUBLE_EQ(value_at(*input, "U[0]", 1), (1 * 3 + 3 * 1) / 4.0);
  EXPECT_DOUBLE_EQ(value_at(*input, "U", 1), std::hypot(1.5, 1.5, 2.5)) << "the magnitude of the mean";
  EXPECT_DOUBLE_EQ(input->volume, 6);
  EXPECT_THAT(conversions(path), ElementsAre("p, U: of cells, averaged to points"));
}

TEST_F(CellDataTest, LeavesMissingValuesOutOfMeans) {
  const std::string path =
      write("a.vtu", Boxes{{0, 1, 4, 6, 8}, "", array("p", {2, std::nan(""), std::nan(""), 1})}.file());
  const auto input = read_input({path});
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_EQ(value_at(*input, "p", 1), 2);
  EXPECT_TRUE(std::isnan(value_at(*input, "p", 4)));
  EXPECT_EQ(value_at(*input, "p", 6), 1);
}

TEST_F(CellDataTest, OfAGhostCopyCountsAndOfAHiddenCellNot) {
  constexpr double duplicate = 1, hidden = 32;
  for (const auto& [flag, expected] : {std::pair{duplicate, 5.0}, {hidden, 2.0}}) {
    const std::string path =
        write("a.vtu", Boxes{{0, 1, 4}, "", array("p", {2, 6}) + array("vtkGhostType", {0, flag}, 1, "UInt8")}.file());
    const auto input = read_input({path});
    ASSERT_TRUE(input) << input.error().message;
    EXPECT_EQ(value_at(*input, "p", 1), expected);
    EXPECT_EQ(input->points, 8u);
    const auto own = read_input({path}, own_cells());
    ASSERT_TRUE(own) << own.error().message;
    EXPECT_EQ(own->points, 1u);
  }
}

TEST_F(CellDataTest, TakesAnotherNameIfPointsHaveItsName) {
  const std::vector<double> at_points = {1, 1, 1, 1, 5, 5, 5, 5};
  const std::string path =
      write("a.vtu",
            Boxes{{0, 1}, array("p", at_points) + array("U[1]", at_points), array("U", {1, 2, 2}, 3) + array("p", {9})}
                .file());
  const auto input = read_input({path});
  ASSERT_TRUE(input) << input.error().message;
  EXPECT_THAT(input->attributes,
              ElementsAre("p", "U[1]", "U (cells)", "U (cells)[0]", "U (cells)[1]", "U (cells)[2]", "p (cells)"));
  EXPECT_EQ(value_at(*input, "p", 1), 5);
  EXPECT_EQ(value_at(*input, "p (cells)", 1), 9);
  EXPECT_THAT(conversions(path), ElementsAre("U (cells), p (cells): of cells, averaged to points"));
  for (const char* name : {"p (cells)", "U (cells)[2]", "p"}) {
    const auto selected = read_input({path}, {{name}, {}});
    ASSERT_TRUE(selected) << selected.error().message;
    EXPECT_THAT(selected->attributes, ElementsAre(name));
  }
  EXPECT_EQ(value_at(*read_input({path}, {{"p (cells)"}, {}}), "p (cells)", 0), 9);
  EXPECT_EQ(value_at(*read_input({path}, {{"p"}, {}}), "p", 0), 1);
  EXPECT_THAT(conversions(path, {{"p"}, {}}), IsEmpty());
  EXPECT_THAT(error_of({path}, {{"p (points)"}, {}}), HasSubstr("there are: p, U[1], U (cells)"));

  const auto own = read_input({path}, own_cells());
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_THAT(own->attributes, ElementsAre("U", "U[0]", "U[1]", "U[2]", "p", "p (points)", "U[1] (points)"));
  EXPECT_EQ(value_at(*own, "p", 0.5), 9);
  EXPECT_DOUBLE_EQ(value_at(*own, "p (points)", 0.5), 3);
}

TEST_F(CellDataTest, OwnCellsArePointsWithOneValue) {
  const std::string path = write(
      "a.vtu",
      Boxes{{0, 1, 4, 4}, array("z", {0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1}), array("p", {2, 6, 8})}.file());
  const auto input = read_input({path}, own_cells());
  ASSERT_TRUE(input) << input.error().message;
  ASSERT_EQ(input->pieces.size(), 1u);
  const Piece& piece = input->pieces[0];
  ASSERT_EQ(piece.points.size(), 2u) << "the third box is flat";
  EXPECT_EQ(input->census.left_out_flat, 1u);
  EXPECT_EQ(input->census.cells.at("hexahedron"), 3u);
  EXPECT_THAT(input->attributes, ElementsAre("p", "z"));
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
  Boxes points{{0, 1, 2}, array("s", {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}), ""};
  std::string file = points.file();
  for (std::size_t at = file.find("12 12"); at != std::string::npos; at = file.find("12 12"))
    file.replace(at, 5, "2 2");
  EXPECT_THAT(error_of({write("a.vtu", file)}, own_cells()), HasSubstr("no cells with a volume"));
  EXPECT_THAT(error_of({"gen:mesh:cells=100"}, own_cells()), AllOf(HasSubstr("gen:mesh"), HasSubstr("--cells own")));
}

/// Planes of the points of an input in these files, by the points' x.
std::vector<std::pair<double, BoundaryPlane>> planes_of(const std::vector<std::string>& paths) {
  auto source = open_source(paths, own_cells());
  EXPECT_TRUE(source) << source.error().message;
  auto points = PointStream::create(**source, true, std::size_t{1} << 24, ::testing::TempDir(), [](double) {});
  EXPECT_TRUE(points) << points.error().message;
  PointBatch batch;
  batch.resize_attributes((*source)->attributes().size());
  while (*points->next(batch)) {
  }
  std::vector<std::pair<double, BoundaryPlane>> planes;
  for (std::size_t i = 0; i < batch.size(); ++i) planes.emplace_back(batch.positions[i].x, batch.planes.at(i));
  std::ranges::sort(planes, {}, [](const auto& plane) { return plane.first; });
  return planes;
}

// Boxes as wide as they are high, so that the plane of a box at an end of the row is that of the end or of a side.
TEST_F(CellDataTest, OwnCellsHaveNoPlaneWhereCellsTouch) {
  const std::string whole = write("whole.vtu", Boxes{{0, 0.25, 0.5, 0.75, 1}, "", array("p", {1, 2, 3, 4})}.file());
  const std::string left = write("left.vtu", Boxes{{0, 0.25, 0.5}, "", array("p", {1, 2})}.file());
  const std::string right = write("right.vtu", Boxes{{0.5, 0.75, 1}, "", array("p", {3, 4})}.file());
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
  auto source = open_source({write("a.vtu", Boxes{x, "", array("p", values)}.file())}, own_cells());
  ASSERT_TRUE(source) << source.error().message;
  const auto report = build_volume(**source, path("out.svol"), {}, [](const char*, double) {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->resolution_counts.back(), 39u);
  EXPECT_EQ(report->connectivity, Connectivity::mesh);
  EXPECT_EQ(report->missing.at(0).second, 1u);
  EXPECT_EQ(report->points.merged, 0u);
}

}  // namespace
}  // namespace splatvol
