// Contours of the cells of a file: closed, and as large as the mesh's own.
#include "sampler/contour.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <vtkCellArray.h>
#include <vtkDataArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkXMLPolyDataReader.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

#include "base/file.h"
#include "extractor/last_boxes.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/builder/support/mesh_of_shapes.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tools/export/contour_export.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;
constexpr double none = std::numeric_limits<double>::quiet_NaN();

struct Surface {
  std::vector<dvec3> points;
  std::vector<std::array<std::size_t, 3>> triangles;
  std::map<std::string, std::vector<double>> values = {};

  [[nodiscard]] double area() const {
    double sum = 0;
    for (const auto& [a, b, c] : triangles)
      sum += glm::length(glm::cross(points[b] - points[a], points[c] - points[a])) / 2;
    return sum;
  }
  [[nodiscard]] double volume() const {
    double sum = 0;
    for (const auto& [a, b, c] : triangles) sum += glm::dot(points[a], glm::cross(points[b], points[c])) / 6;
    return sum;
  }
  // How many edges two triangles have, one in each direction, and how many others there are.
  [[nodiscard]] std::pair<std::size_t, std::size_t> edges() const {
    std::map<std::pair<std::size_t, std::size_t>, int> directions;
    for (const auto& t : triangles)
      for (std::size_t k = 0; k < 3; ++k) ++directions[{t[k], t[(k + 1) % 3]}];
    std::size_t shared = 0, others = 0;
    for (const auto& [edge, count] : directions) {
      const auto back = directions.find({edge.second, edge.first});
      ++(count == 1 && back != directions.end() && back->second == 1 ? shared : others);
    }
    return {shared / 2, others};
  }
};

// Joins vertices of one position.
class Welder {
 public:
  std::size_t number_of(const dvec3& point) {
    const auto [at, is_new] = numbers_.try_emplace({point.x, point.y, point.z}, surface.points.size());
    if (is_new) surface.points.push_back(point);
    return at->second;
  }
  Surface surface;

 private:
  std::map<std::array<double, 3>, std::size_t> numbers_;
};

Surface read_vtp(const std::string& path) {
  vtkNew<vtkXMLPolyDataReader> reader;
  reader->SetFileName(path.c_str());
  reader->Update();
  vtkPolyData* data = reader->GetOutput();
  Surface surface;
  for (vtkIdType i = 0; i < data->GetNumberOfPoints(); ++i) {
    const double* p = data->GetPoint(i);
    surface.points.emplace_back(p[0], p[1], p[2]);
  }
  vtkNew<vtkIdList> corners;
  for (vtkIdType i = 0; i < data->GetNumberOfCells(); ++i) {
    data->GetCellPoints(i, corners);
    surface.triangles.push_back({});
    for (vtkIdType k = 0; k < 3; ++k)
      surface.triangles.back()[static_cast<std::size_t>(k)] = static_cast<std::size_t>(corners->GetId(k));
  }
  for (int a = 0; a < data->GetPointData()->GetNumberOfArrays(); ++a) {
    vtkDataArray* array = data->GetPointData()->GetArray(a);
    for (vtkIdType i = 0; i < array->GetNumberOfTuples(); ++i)
      surface.values[array->GetName()].push_back(array->GetComponent(i, 0));
  }
  return surface;
}

template <class Number>
Number number_at(const std::string& bytes, std::size_t offset) {
  Number number{};
  std::memcpy(&number, bytes.data() + offset, sizeof(number));
  return number;
}

dvec3 point_at(const std::string& bytes, std::size_t offset) {
  return {number_at<float>(bytes, offset), number_at<float>(bytes, offset + 4), number_at<float>(bytes, offset + 8)};
}

Surface read_stl(const std::string& path) {
  const std::string bytes = value_of(read_text_file(path));
  const auto count = number_at<std::uint32_t>(bytes, 80);
  EXPECT_EQ(bytes.size(), 84 + 50 * std::size_t{count});
  Welder welder;
  for (std::size_t t = 0; t < count; ++t) {
    std::array<std::size_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) corners[k] = welder.number_of(point_at(bytes, 84 + 50 * t + 12 * (k + 1)));
    welder.surface.triangles.push_back(corners);
    const dvec3 normal = point_at(bytes, 84 + 50 * t), &a = welder.surface.points[corners[0]];
    const dvec3 cross = glm::cross(welder.surface.points[corners[1]] - a, welder.surface.points[corners[2]] - a);
    EXPECT_TRUE(glm::length(cross) < 1e-5 || glm::dot(normal, cross) > 0.9 * glm::length(cross)) << t;
  }
  return welder.surface;
}

Surface read_glb(const std::string& path) {
  const std::string bytes = value_of(read_text_file(path));
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(number_at<std::uint32_t>(bytes, 8), bytes.size());
  const auto length = number_at<std::uint32_t>(bytes, 12);
  EXPECT_EQ(length % 4, 0);
  const auto json = nlohmann::json::parse(bytes.substr(20, length));
  const std::size_t numbers = 20 + length + 8;
  const auto& views = json["bufferViews"];
  const auto& accessors = json["accessors"];
  Surface surface;
  const std::size_t indices = numbers, positions = numbers + views[1]["byteOffset"].get<std::size_t>();
  Box box;
  for (std::size_t i = 0; i < accessors[1]["count"].get<std::size_t>(); ++i) {
    surface.points.push_back(point_at(bytes, positions + 12 * i));
    box.include(surface.points.back());
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_EQ(accessors[1]["min"][static_cast<std::size_t>(axis)].get<double>(), box.low[axis]);
    EXPECT_EQ(accessors[1]["max"][static_cast<std::size_t>(axis)].get<double>(), box.high[axis]);
  }
  for (std::size_t t = 0; t < accessors[0]["count"].get<std::size_t>() / 3; ++t)
    surface.triangles.push_back({number_at<std::uint32_t>(bytes, indices + 12 * t),
                                 number_at<std::uint32_t>(bytes, indices + 12 * t + 4),
                                 number_at<std::uint32_t>(bytes, indices + 12 * t + 8)});
  return surface;
}

// The area of the contour of tetrahedra, one by one: the polygon of the points where their edges have the value.
double area_of(const Mesh& mesh, const std::function<double(dvec3)>& field, double value) {
  double area = 0;
  for (const auto& corners : mesh.tetrahedra) {
    std::vector<dvec3> polygon;
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = 0; j < i; ++j) {
        const dvec3 &a = mesh.points[corners[i]], &b = mesh.points[corners[j]];
        const double from = field(a) - value, to = field(b) - value;
        if ((from >= 0) != (to >= 0)) polygon.push_back(a + from / (from - to) * (b - a));
      }
    // Four points in any order are the corners of a convex quadrilateral: the largest sum of two triangles on a
    // diagonal.
    const auto of = [&](std::size_t a, std::size_t b, std::size_t c) {
      return glm::length(glm::cross(polygon[b] - polygon[a], polygon[c] - polygon[a])) / 2;
    };
    if (polygon.size() == 3) area += of(0, 1, 2);
    if (polygon.size() == 4) area += (of(0, 1, 2) + of(0, 1, 3) + of(0, 2, 3) + of(1, 2, 3)) / 2;
  }
  return area;
}

struct Contour : FolderTest {
  [[nodiscard]] static BuildOptions exact() {
    return {.exact = {.positions = true, .values = true}, .keep_cells = true};
  }

  Result<ContourReport> write(const std::string& from, const std::string& to, double value,
                              const std::vector<std::string>& attributes = {}, std::uint64_t memory = 1 << 26,
                              const Box& box = format::SplatSelection().box) const {
    const auto volume = value_of(format::Volume::open(*open_file(path(from))));
    const auto selection = value_of(format::select_splats(*volume, {}, attributes, box));
    return export_contour(*volume, path(to), selection, value, memory, [](double) {});
  }
};

// Single precision has the values.
double distance(const dvec3& p) { return double{static_cast<float>(0.5 - glm::length(p - dvec3(0.5)))}; }

TEST_F(Contour, OfASphereIsClosedAndAsLargeAsTheMeshs) {
  const Mesh mesh = jittered(24, 0.2);
  build_mesh(mesh, distance, path("mesh.svol"), exact());
  const double radius = 0.3, area = area_of(mesh, distance, 0.5 - radius);
  for (const std::string name : {"out.vtp", "out.stl", "out.glb"}) {
    const ContourReport report = value_of(write("mesh.svol", name, 0.5 - radius));
    EXPECT_NEAR(report.area, area, 1e-9 * area) << name;
    EXPECT_TRUE(report.closed);
    EXPECT_NEAR(report.volume, 4 * std::numbers::pi / 3 * std::pow(radius, 3), 2e-3);
    const Surface surface = name == "out.vtp"   ? read_vtp(path(name))
                            : name == "out.stl" ? read_stl(path(name))
                                                : read_glb(path(name));
    EXPECT_EQ(report.triangles, surface.triangles.size());
    EXPECT_EQ(report.vertices, name == "out.stl" ? 0 : surface.points.size());
    EXPECT_EQ(surface.edges().second, 0) << name;
    EXPECT_EQ(surface.points.size() + surface.triangles.size(), surface.edges().first + 2) << "Euler: a sphere";
    const double precision = name == "out.vtp" ? 1e-12 : 1e-6;
    EXPECT_NEAR(surface.area(), report.area, precision);
    EXPECT_NEAR(surface.volume(), report.volume, precision);
  }
}

TEST_F(Contour, OfHexahedraIsClosedRoundAHole) {
  // Cubes, each moved in a way that bends their faces.
  constexpr int n = 10;
  std::string points, cells, values;
  for (int z = 0; z <= n; ++z)
    for (int y = 0; y <= n; ++y)
      for (int x = 0; x <= n; ++x) {
        const dvec3 p =
            dvec3(x, y, z) / double{n} + 0.02 * dvec3(std::sin(7.0 * y), std::sin(8.0 * z), std::sin(9.0 * x));
        points += fmt::format("{} {} {}\n", p.x, p.y, p.z);
        values += fmt::format("{}\n", -distance(p));
      }
  const auto at = [](int x, int y, int z) { return x + (n + 1) * (y + (n + 1) * z); };
  for (int z = 0; z < n; ++z)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
        cells += fmt::format("8 {} {} {} {} {} {} {} {}\n", at(x, y, z), at(x + 1, y, z), at(x + 1, y + 1, z),
                             at(x, y + 1, z), at(x, y, z + 1), at(x + 1, y, z + 1), at(x + 1, y + 1, z + 1),
                             at(x, y + 1, z + 1));
  const int count = n * n * n, of_points = (n + 1) * (n + 1) * (n + 1);
  std::string types;
  for (int i = 0; i < count; ++i) types += "12\n";
  std::ofstream(path("cubes.vtk")) << "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS "
                                   << of_points << " double\n"
                                   << points << "CELLS " << count << " " << 9 * count << "\n"
                                   << cells << "CELL_TYPES " << count << "\n"
                                   << types << "POINT_DATA " << of_points
                                   << "\nSCALARS value double 1\nLOOKUP_TABLE default\n"
                                   << values;
  build_input(path("cubes.vtk"), path("cubes.svol"), {.keep_cells = true});
  const ContourReport report = value_of(write("cubes.svol", "out.vtp", -0.2));
  EXPECT_TRUE(report.closed);
  EXPECT_NEAR(report.volume, -4 * std::numbers::pi / 3 * 0.027, 0.01) << "the values above enclose a hole";
  EXPECT_EQ(read_vtp(path("out.vtp")).edges().second, 0);
}

// Values that are exactly the contour's count as inside, whole faces of them too.
TEST_F(Contour, AtValuesOfPointsStaysClosed) {
  const Mesh mesh = lattice(8);
  const auto field = [](dvec3 p) {
    return 4 - std::max({std::abs(8 * p.x - 4), std::abs(8 * p.y - 4), std::abs(8 * p.z - 4)});
  };
  build_mesh(mesh, field, path("mesh.svol"), exact());
  for (const double value : {1.0, 2.0, 3.0}) {
    const ContourReport report = value_of(write("mesh.svol", "out.stl", value));
    EXPECT_TRUE(report.closed);
    EXPECT_NEAR(report.volume, std::pow((4 - value) / 4, 3), 1e-12);
    EXPECT_EQ(read_stl(path("out.stl")).edges().second, 0) << value;
  }
}

TEST_F(Contour, HasTheValuesOfAttributes) {
  const Mesh mesh = jittered(10, 0.2);
  Piece piece = mesh_piece(mesh, distance);
  piece.values.push_back(sample(mesh, [](dvec3 p) { return p.x < 0.3 ? none : 2 * p.x + p.z; }));
  PieceSource source({piece}, {.attributes = {"value", "colour"}});
  ASSERT_TRUE(build_volume(source, path("mesh.svol"), exact(), [](const char*, double) {}));
  ASSERT_TRUE(write("mesh.svol", "out.vtp", 0.2, {"value", "colour"}));
  const Surface surface = read_vtp(path("out.vtp"));
  std::size_t missing = 0;
  for (std::size_t i = 0; i < surface.points.size(); ++i) {
    EXPECT_EQ(surface.values.at("value")[i], 0.2);
    const dvec3& p = surface.points[i];
    const double colour = surface.values.at("colour")[i];
    EXPECT_TRUE(p.x < 0.42 || std::abs(colour - (2 * p.x + p.z)) < 1e-6) << i;
    EXPECT_TRUE(p.x > 0.28 || std::isnan(colour)) << i;
    missing += std::isnan(colour) ? 1 : 0;
  }
  EXPECT_GT(missing, 0);
}

TEST_F(Contour, MemoryChangesNothing) {
  build_mesh(jittered(24, 0.2), distance, path("mesh.svol"), {.keep_cells = true});
  ASSERT_TRUE(write("mesh.svol", "much.vtp", 0.2));
  ASSERT_TRUE(write("mesh.svol", "little.vtp", 0.2, {}, 1 << 20));
  EXPECT_EQ(value_of(read_text_file(path("much.vtp"))), value_of(read_text_file(path("little.vtp"))));
  EXPECT_THAT(message_of(write("mesh.svol", "none.vtp", 0.2, {}, 1 << 12)), HasSubstr("--memory"));
  EXPECT_TRUE(write("mesh.svol", "none.stl", 0.2, {}, 1 << 12));
}

TEST_F(Contour, EndsAtABoxAndAtTheMesh) {
  build_mesh(
      lattice(8), [](dvec3 p) { return p.x; }, path("mesh.svol"), exact());
  const ContourReport all = value_of(write("mesh.svol", "out.vtp", 0.3));
  EXPECT_FALSE(all.closed);
  EXPECT_NEAR(all.area, 1, 1e-12);
  for (const dvec3& p : read_vtp(path("out.vtp")).points) EXPECT_NEAR(p.x, 0.3, 1e-15);
  // Whole cells: those from 0.375 to 0.5 touch the box.
  const ContourReport part = value_of(write("mesh.svol", "out.vtp", 0.3, {}, 1 << 26, {dvec3(-1), dvec3(1, 0.45, 1)}));
  EXPECT_NEAR(part.area, 0.5, 1e-12);
}

TEST_F(Contour, WhatCannotBeIsOneLine) {
  build_mesh(
      lattice(3), [](dvec3 p) { return p.x; }, path("mesh.svol"), exact());
  EXPECT_THAT(message_of(write("mesh.svol", "out.vtp", 7)),
              HasSubstr("\"value\" has values from 0 to 1, and nowhere 7"));
  build_mesh(lattice(3), [](dvec3 p) { return p.x; }, path("none.svol"), {});
  EXPECT_THAT(message_of(write("none.svol", "out.vtp", 0.5)), HasSubstr("keeps no cells"));
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  EXPECT_THAT(message_of(write("own.svol", "out.vtp", 0.5)), HasSubstr("values of their own"));
  build_input(path("shapes.vtk"), path("points.svol"), exact(), {.selection = {"value"}});
  EXPECT_TRUE(write("points.svol", "out.vtp", 2.1)) << "all shapes";
  EXPECT_FALSE(open_file(path("none.vtp")));
}

TEST(LastBoxes, FindsTheLastThatHolds) {
  const std::vector<Box> boxes = {
      {dvec3(0), dvec3(2)}, {dvec3(1), dvec3(3)}, {dvec3(5), dvec3(6)}, {dvec3(0), dvec3(1)}, {dvec3(5), dvec3(7)}};
  const LastBoxes last(boxes);
  EXPECT_EQ(last.last_above(0, dvec3(1.5)), 1);
  EXPECT_EQ(last.last_above(0, dvec3(1)), 3);
  EXPECT_EQ(last.last_above(3, dvec3(1)), 3);
  EXPECT_EQ(last.last_above(0, dvec3(9)), 0);
  EXPECT_EQ(last.last_above(2, dvec3(6.5)), 4);
}

}  // namespace
}  // namespace splatvol::test
