#include "builder/opening/open_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>

#include "base/file.h"
#include "builder/opening/formats.h"
#include "builder/opening/input_files.h"
#include "builder/sources/numpy/npy_header.h"
#include "builder/sources/vtk/writer.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

// VTK's readers leak a little if they give up on a damaged file. The leak checker asks here which leaks to ignore.
extern "C" const char* __lsan_default_suppressions() { return "leak:libvtk"; }

namespace splatvol::test {
namespace {

using namespace ::testing;

const std::string shared = SPLATVOL_SHARED;
constexpr double inf = std::numeric_limits<double>::infinity();

const std::vector<dvec3> cube = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                 {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};

VtuMesh hexahedron_mesh() {
  return {.points = cube, .cells = {{12, {0, 1, 2, 3, 4, 5, 6, 7}}}, .point_data = {{"s", {0, 1, 2, 3, 4, 5, 6, 7}}}};
}

using SourceTest = FolderTest;

TEST_F(SourceTest, VectorsGiveMagnitudeAndComponents) {
  VtuMesh mesh = hexahedron_mesh();
  mesh.point_data.push_back({"U", {3, 0, 4, 1, 2, 2}, 3});
  mesh.point_data.back().values.resize(24);
  mesh.point_data.push_back({"name", std::vector<double>(8), 1, "String"});
  const std::string path = write("a.vtu", mesh.file());
  const auto all = value_of(read_input({path}));
  EXPECT_THAT(all.attributes, ElementsAre("s", "U", "U[0]", "U[1]", "U[2]"));
  EXPECT_EQ(all.pieces[0].values[1][0], 5);
  EXPECT_EQ(all.pieces[0].values[1][1], 3);
  EXPECT_EQ(all.pieces[0].values[3][1], 2);
  EXPECT_EQ(all.pieces[0].points, cube);
  EXPECT_EQ(all.census.cells.at("hexahedron"), 1u);
  EXPECT_DOUBLE_EQ(all.volume, 1);

  const auto some = value_of(read_input({path}, {{"U[2]", "s"}, {}}));
  EXPECT_THAT(some.attributes, ElementsAre("U[2]", "s"));
  EXPECT_EQ(some.pieces[0].values[0][0], 4);
  EXPECT_EQ(some.pieces[0].values[1][7], 7);
  EXPECT_THAT(error_of({path}, {{"s", "T"}, {}}),
              AllOf(StartsWith(path), HasSubstr("\"T\""), HasSubstr("s, U, U[0], U[1], U[2]")));
  EXPECT_THAT(error_of({path}, {{"U[3]"}, {}}), HasSubstr("no attribute \"U[3]\""));
}

TEST_F(SourceTest, ValuesThatAreNotFiniteAreMissing) {
  std::vector<float> values = {1, std::nanf(""), static_cast<float>(inf), static_cast<float>(-inf)};
  const std::array<PointArray, 2> arrays = {PointArray{"s", 1, values}, PointArray{"v", 1, {1e30f, 2, 3, 4}}};
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, inf}};
  const std::array<std::array<std::uint32_t, 4>, 1> tetrahedra = {{{0, 1, 2, 3}}};
  ASSERT_TRUE(write_vtu(folder_ + "a.vtu", points, tetrahedra, arrays));
  const auto input = value_of(read_input({folder_ + "a.vtu"}));
  const auto& s = input.pieces[0].values[0];
  EXPECT_EQ(s[0], 1);
  EXPECT_TRUE(std::isnan(s[1]) && std::isnan(s[2]) && std::isnan(s[3]));
  EXPECT_EQ(input.pieces[0].points.size(), 4u) << "points stay, whatever their position";
  EXPECT_EQ(input.census.non_finite, 1u);
  EXPECT_EQ(input.census.tetrahedra, 0u);
}

TEST_F(SourceTest, CellTypesAreToldApart) {
  VtuMesh mesh = hexahedron_mesh();
  mesh.cells = {{10, {0, 1, 2, 5}},
                {11, {0, 1, 3, 2, 4, 5, 7, 6}},
                {13, {0, 3, 1, 4, 7, 5}},
                {14, {0, 1, 2, 3, 4}},
                {9, {0, 1, 2, 3}},
                {5, {0, 1, 2}},
                {3, {0, 1}},
                {1, {0}}};
  const auto input = value_of(read_input({write("a.vtu", mesh.file())}));
  for (const char* name : {"tetrahedron", "voxel", "wedge", "pyramid", "quadrilateral", "triangle", "line", "vertex"})
    EXPECT_EQ(input.census.cells.at(name), 1u) << name;
  EXPECT_EQ(input.census.without_volume, 4u);
  EXPECT_NEAR(input.volume, 1.0 / 6 + 1 + 0.5 + 1.0 / 3, 1e-15);

  mesh.cells = {{41, {0, 1, 2, 3, 4, 5, 6, 7}}};
  EXPECT_THAT(error_of({write("b.vtu", mesh.file())}), HasSubstr("VTK type 41"));
  mesh.cells = {{12, {0, 1, 2, 3, 4}}};
  EXPECT_THAT(error_of({write("c.vtu", mesh.file())}), HasSubstr("a hexahedron of 5 points instead of 8"));
}

TEST_F(SourceTest, LinearCellsWithMoreNodesThanCornersLoseTheOthers) {
  VtuMesh mesh = hexahedron_mesh();
  for (int i = 0; i < 12; ++i) mesh.points.emplace_back(0.5);  // wherever they are
  mesh.point_data[0].values.resize(20);
  mesh.cells[0].points.resize(20);
  std::iota(mesh.cells[0].points.begin(), mesh.cells[0].points.end(), 0);
  const auto input = value_of(read_input({write("a.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(input.volume, 1);
  EXPECT_EQ(input.census.more_nodes, 1u);
  EXPECT_EQ(input.census.tetrahedra, 6u);

  mesh.cells[0].type = 25;
  mesh.cells[0].points.push_back(0);
  EXPECT_THAT(error_of({write("b.vtu", mesh.file())}), HasSubstr("a quadratic hexahedron of 21 points instead of 20"));
}

std::string structured_file(const std::string& type, const std::string& extent, const std::string& attributes,
                            const std::string& body) {
  return vtk_file(type, fmt::format("<Piece Extent=\"{}\">{}</Piece>", extent, body),
                  fmt::format("WholeExtent=\"{}\" {}", extent, attributes));
}

TEST_F(SourceTest, CellsThatAreNoVolumesAreTold) {
  const auto told = [&](const std::string& path) {
    const auto input = read_input({path});
    return input ? describe_no_volume(input->census) : input.error().message;
  };
  const std::string values = "<PointData>" + data_arrays({{"s", {0, 1, 2, 3, 4, 5}}}) + "</PointData>";
  const std::string spacing = "Origin=\"0 0 0\" Spacing=\"1 1 1\"";
  EXPECT_EQ(told(write("flat.vti", structured_file("ImageData", "0 2 0 1 0 0", spacing, values))),
            "only surface cells (2 pixels)");
  EXPECT_EQ(told(write("thin.vti", structured_file("ImageData", "0 5 0 0 0 0", spacing, values))),
            "only lines (5 lines)");
  const std::string layer =
      "<Points>" + data_arrays({{"Points", {0, 0, 0, 1, 0, 0, 2, 0, 1, 0, 1, 0, 1, 1, 0, 2, 1, 1}, 3}}) + "</Points>";
  EXPECT_EQ(told(write("layer.vts", structured_file("StructuredGrid", "0 2 0 1 3 3", "", values + layer))),
            "only surface cells (2 quadrilaterals)");

  VtuMesh mesh = hexahedron_mesh();
  mesh.cells = {{5, {0, 1, 2}}, {5, {0, 2, 3}}, {9, {4, 5, 6, 7}}, {3, {0, 4}}};
  EXPECT_EQ(told(write("a.vtu", mesh.file())), "only surface cells and lines (1 line, 1 quadrilateral, 2 triangles)");
  mesh.cells = {{1, {0}}, {2, {1, 2, 3}}};
  EXPECT_EQ(told(write("b.vtu", mesh.file())), "") << "vertices stay points";
  mesh.cells = {};
  EXPECT_EQ(told(write("c.vtu", mesh.file())), "");
  mesh.cells = {{10, {0, 1, 2, 4}}, {9, {4, 5, 6, 7}}};
  EXPECT_EQ(told(write("d.vtu", mesh.file())), "") << "surfaces beside volumes are left out";
  mesh.cells = {{10, {0, 0, 1, 2}}};
  EXPECT_EQ(told(write("e.vtu", mesh.file())), "no cell fills a volume (1 tetrahedron)");
}

TEST_F(SourceTest, FilesWithTheSamePointsAreNoPieces) {
  VtuMesh mesh = hexahedron_mesh();
  const std::string first = write("step_1.vtu", mesh.file());
  mesh.point_data[0].values[3] = 9;
  const std::string second = write("step_2.vtu", mesh.file());
  EXPECT_THAT(error_of({first, second}), AllOf(StartsWith(second), HasSubstr(first), HasSubstr("--series")));
  EXPECT_THAT(error_of({folder_}), HasSubstr("--series"));

  // Without cells too.
  mesh.cells.clear();
  EXPECT_THAT(error_of({write("a.vtu", mesh.file()), write("b.vtu", mesh.file())}), HasSubstr("--series"));

  // The other half of a mesh: the points of one side, or all points, are common.
  mesh = hexahedron_mesh();
  for (dvec3& p : mesh.points) p.x += 1;
  EXPECT_EQ(error_of({first, write("half.vtu", mesh.file())}), "(no error)");
  mesh = hexahedron_mesh();
  mesh.cells = {{13, {0, 1, 3, 4, 5, 7}}};
  const std::string one = write("one.vtu", mesh.file());
  mesh.cells = {{13, {1, 2, 3, 5, 6, 7}}};
  const auto halves = value_of(read_input({one, write("two.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(halves.volume, 1);

  // The same bounds and number of points are not enough.
  mesh = hexahedron_mesh();
  mesh.points.emplace_back(0.5);
  mesh.point_data[0].values.push_back(0);
  const std::string middle = write("middle.vtu", mesh.file());
  mesh.points.back().x = 0.25;
  EXPECT_EQ(error_of({middle, write("moved.vtu", mesh.file())}), "(no error)");
}

/// A Lagrange hexahedron of 27 points in the order of VTK 9: corners, edges, faces (-x, +x, -y, +y, -z, +z), middle.
VtuMesh quadratic_mesh() {
  VtuMesh mesh;
  const std::vector<std::array<std::size_t, 2>> edges = {{0, 1}, {1, 2}, {3, 2}, {0, 3}, {4, 5}, {5, 6},
                                                         {7, 6}, {4, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};
  mesh.points = cube;
  for (const auto& [a, b] : edges) mesh.points.push_back((cube[a] + cube[b]) / 2.0);
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {0.0, 1.0}) {
      mesh.points.emplace_back(0.5);
      mesh.points.back()[axis] = side;
    }
  mesh.points.emplace_back(0.5);
  mesh.cells = {{72, std::vector<int>(27)}};
  std::iota(mesh.cells[0].points.begin(), mesh.cells[0].points.end(), 0);
  mesh.point_data = {{"s", std::vector<double>(27)}};
  return mesh;
}

TEST_F(SourceTest, HigherOrderCells) {
  VtuMesh mesh = quadratic_mesh();
  mesh.version = "2.2";
  const auto lagrange = value_of(read_input({write("a.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(lagrange.volume, 1);
  EXPECT_EQ(lagrange.census.tetrahedra, 48u);
  EXPECT_EQ(lagrange.census.inverted, 0u);

  // Before 2.1 the last two edges came in the other order.
  mesh.version = "2.0";
  std::swap(mesh.cells[0].points[18], mesh.cells[0].points[19]);
  const auto old = value_of(read_input({write("b.vtu", mesh.file())}));
  EXPECT_EQ(old.census.inverted, 0u);
  EXPECT_DOUBLE_EQ(old.volume, 1);

  mesh.version = "2.2";
  mesh.cells = {{25, std::vector<int>(20)}};
  std::iota(mesh.cells[0].points.begin(), mesh.cells[0].points.end(), 0);
  const auto quadratic = value_of(read_input({write("c.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(quadratic.volume, 1);

  mesh.cells = {{72, std::vector<int>(20)}};
  EXPECT_THAT(error_of({write("d.vtu", mesh.file())}), HasSubstr("a Lagrange hexahedron of 20 points"));
}

constexpr const char* old_faces =
    "<DataArray type=\"Int64\" Name=\"faces\" format=\"ascii\">6 4 0 3 2 1 4 4 5 6 7 4 0 1 5 4 4 1 2 6 5 4 2 3 7 6 4 3 "
    "0 4 7</DataArray>\n"
    "<DataArray type=\"Int64\" Name=\"faceoffsets\" format=\"ascii\">31 -1</DataArray>\n";
constexpr const char* new_faces =
    "<DataArray type=\"Int64\" Name=\"face_connectivity\" format=\"ascii\">0 3 2 1 4 5 6 7 0 1 5 4 1 2 6 5 2 3 7 6 3 0 "
    "4 7</DataArray>\n"
    "<DataArray type=\"Int64\" Name=\"face_offsets\" format=\"ascii\">4 8 12 16 20 24</DataArray>\n"
    "<DataArray type=\"Int64\" Name=\"polyhedron_to_faces\" format=\"ascii\">5 4 3 2 1 0</DataArray>\n"
    "<DataArray type=\"Int64\" Name=\"polyhedron_offsets\" format=\"ascii\">6 6</DataArray>\n";

VtuMesh polyhedron_mesh() {
  VtuMesh mesh = hexahedron_mesh();
  mesh.cells = {{42, {0, 1, 2, 3, 4, 5, 6, 7}}, {10, {0, 1, 2, 5}}};
  mesh.extra_cell_arrays = new_faces;
  return mesh;
}

TEST_F(SourceTest, PolyhedraOfEveryFileVersion) {
  VtuMesh mesh = polyhedron_mesh();
  for (const auto& [version, faces] : {std::pair{"0.1", old_faces}, {"2.2", old_faces}, {"2.3", new_faces}}) {
    SCOPED_TRACE(version);
    mesh.version = version;
    mesh.extra_cell_arrays = faces;
    const auto input = value_of(read_input({write("a.vtu", mesh.file())}));
    EXPECT_DOUBLE_EQ(input.volume, 1 + 1.0 / 6);
    EXPECT_EQ(input.census.cells.at("polyhedron"), 1u);
    EXPECT_EQ(input.census.tetrahedra, 7u);
  }
  mesh.extra_cell_arrays.clear();
  EXPECT_THAT(error_of({write("b.vtu", mesh.file())}), HasSubstr("the faces of polyhedron 0 are missing"));

  const auto damaged = [&](const std::string& from, const std::string& to) {
    mesh.extra_cell_arrays = replaced(new_faces, from, to);
    return error_of({write("c.vtu", mesh.file())});
  };
  EXPECT_THAT(damaged("5 4 3 2 1 0", "5 4 3 2 1 7"), HasSubstr("polyhedron_to_faces"));
  EXPECT_THAT(damaged("5 4 3 2 1 0", "5 4 3 2 1 -1"), HasSubstr("polyhedron_to_faces"));
  EXPECT_THAT(damaged("6 6", "9 9"), HasSubstr("polyhedron_to_faces"));
  EXPECT_THAT(damaged("6 6", "900000000000 900000000000"), HasSubstr("polyhedron_offsets"));
  EXPECT_THAT(damaged("16 20 24", "16 12 24"), HasSubstr("face_offsets"));
  EXPECT_THAT(damaged("Name=\"face_offsets\"", "Name=\"face_ofsets\""), HasSubstr("face_offsets"));
  EXPECT_THAT(damaged("3 0 4 7", "3 0 4 8"), HasSubstr("names point 8 of 8"));
}

TEST_F(SourceTest, NewerVersionsAreRefused) {
  VtuMesh mesh = hexahedron_mesh();
  for (const char* version : {"2.4", "3.0", "12.1"}) {
    mesh.version = version;
    EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), AllOf(HasSubstr(version), HasSubstr("newer than 2.3")));
  }
  mesh.version = "two";
  EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), HasSubstr("\"two\""));
  EXPECT_THAT(error_of({write("a.vtk", "# vtk DataFile Version 6.0\nx\nASCII\n")}), HasSubstr("newer than 5.1"));
}

TEST_F(SourceTest, ArraysOfUnknownTypesAreRefused) {
  // VTK 9.1 crashes on such an array of the whole file.
  std::string text = hexahedron_mesh().file();
  text.insert(text.find("<Piece"),
              "<FieldData><DataArray type=\"loat32\" Name=\"f\" NumberOfTuples=\"1\" "
              "format=\"ascii\">1</DataArray></FieldData>");
  EXPECT_THAT(error_of({write("a.vtu", text)}), HasSubstr("unknown type \"loat32\""));
}

TEST_F(SourceTest, ArraysWithoutANameAreRefused) {
  VtuMesh mesh = hexahedron_mesh();
  mesh.point_data[0].name = "";
  EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), HasSubstr("an array of its PointData has no name"));
}

// VTK gives memory that nobody wrote for arrays of other time steps than the first.
TEST_F(SourceTest, TimeStepsWithinAFileAreRefused) {
  const auto with_step = [](const std::string& step) {
    std::string text = hexahedron_mesh().file();
    const std::size_t at = text.find("<DataArray", text.find("<PointData")) + std::string("<DataArray").size();
    return text.insert(at, " TimeStep=\"" + step + "\"")
        .replace(text.find("<UnstructuredGrid"), 17, "<UnstructuredGrid TimeValues=\"0 1\"");
  };
  for (const char* step : {"1", "0 1"})
    EXPECT_THAT(error_of({write("a.vtu", with_step(step))}), HasSubstr("has time steps in one file"));
  EXPECT_GT(value_of(read_input({write("a.vtu", with_step("0"))})).points, 0u);
}

TEST_F(SourceTest, TagsOfAnyLengthAreRead) {
  std::string text = hexahedron_mesh().file();
  const std::string before = "<DataArray ", spaces(10000, ' ');
  for (std::size_t at = 0; (at = text.find(before, at)) != std::string::npos; at += before.size() + spaces.size())
    text.insert(at + before.size(), spaces);
  EXPECT_EQ(error_of({write("a.vtu", text)}), "(no error)");
  EXPECT_THAT(error_of({write("a.vtu", text.insert(text.find("</DataArray>"), " 5"))}), HasSubstr("instead of"));
}

TEST_F(SourceTest, GhostsAreSkipped) {
  // Three cells in a line; the last belongs to another piece. Later, a point of the first is hidden.
  VtuMesh mesh;
  for (int k = 0; k < 2; ++k)
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 4; ++i) mesh.points.emplace_back(i, j, k);
  mesh.points.emplace_back(9, 9, 9);
  for (int i = 0; i < 3; ++i) mesh.cells.push_back({12, {i, i + 1, i + 5, i + 4, i + 8, i + 9, i + 13, i + 12}});
  std::vector<double> values(17);
  std::iota(values.begin(), values.end(), 0);
  mesh.point_data = {{"s", values}};
  mesh.cell_data = {{"vtkGhostType", {0, 0, 1}, 1, "UInt8"}, {"c", {7, 8, 9}}};
  const auto ghost = value_of(read_input({write("a.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(ghost.volume, 2);
  EXPECT_EQ(ghost.census.hidden, 1u);
  EXPECT_EQ(ghost.census.hidden_points, 4u);
  EXPECT_EQ(ghost.census.cells.at("hexahedron"), 2u);
  EXPECT_THAT(ghost.attributes, ElementsAre("s", "c"));
  EXPECT_THAT(ghost.pieces[0].values[0], ElementsAre(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16))
      << "a point of no cell stays";

  std::vector<double> point_ghosts(17);
  point_ghosts[0] = 2;
  point_ghosts[2] = 1;
  mesh.point_data.push_back({"vtkGhostType", point_ghosts, 1, "UInt8"});
  const auto hidden = value_of(read_input({write("b.vtu", mesh.file())}));
  EXPECT_DOUBLE_EQ(hidden.volume, 1);
  EXPECT_EQ(hidden.census.hidden, 2u);
  EXPECT_EQ(hidden.census.hidden_points, 8u);
  EXPECT_THAT(hidden.attributes, ElementsAre("s", "c"));
  EXPECT_THAT(hidden.pieces[0].values[0], ElementsAre(1, 2, 5, 6, 9, 10, 13, 14, 16))
      << "a copy that a cell needs stays";
}

TEST_F(SourceTest, PiecesComeOneByOne) {
  VtuMesh mesh = hexahedron_mesh();
  VtuMesh moved = mesh;
  for (dvec3& p : moved.points) p.x += 1;
  const std::string two = write("two.vtu", mesh.file_of(mesh.piece() + moved.piece()));
  const auto pieces = value_of(read_input({two}));
  ASSERT_EQ(pieces.pieces.size(), 2u);
  EXPECT_EQ(pieces.pieces[1].points[0].x, 1);
  EXPECT_DOUBLE_EQ(pieces.volume, 2);

  // A partition without points has no arrays either.
  write("pieces/0.vtu", VtuMesh().file());
  write("pieces/1.vtu", moved.file());
  for (dvec3& p : moved.points) p.x += 1;
  const std::string third = write("pieces/third.vtu", mesh.file_of(mesh.piece() + moved.piece()));
  const auto pvtu = [](const std::string& last) {
    return vtk_file("PUnstructuredGrid",
                    "<Piece Source='pieces/0.vtu'/><Piece Source='pieces/1.vtu'/>\n<Piece Source='" + last + "'/>\n",
                    "GhostLevel='0'");
  };
  const auto parallel = value_of(read_input({write("all.pvtu", pvtu("pieces/third.vtu"))}));
  EXPECT_EQ(parallel.pieces.size(), 3u);
  EXPECT_DOUBLE_EQ(parallel.volume, 3);

  const std::string broken = write("broken.pvtu", pvtu("pieces/2.vtu"));
  EXPECT_THAT(error_of({broken}), AllOf(StartsWith(broken), HasSubstr("pieces/2.vtu"), HasSubstr("No such file")));
  EXPECT_THAT(error_of({write("cut.pvtu", pvtu("two.vtu").substr(0, 150))}), StartsWith(folder_ + "cut.pvtu"));

  const auto several = value_of(read_input({third, folder_ + "pieces/1.vtu"}));
  EXPECT_EQ(several.pieces.size(), 3u);
}

TEST_F(SourceTest, TextsOfAnyNameAreTablesIfTheirColumnsAreNamed) {
  for (const char* name : {"a.xyz", "a.pts", "a.dat", "a"}) {
    const std::string path = write(name, "0 0 0 1\n1 0 0 2\n0 1 0 3\n");
    EXPECT_THAT(error_of({path}), HasSubstr("a table needs the names of its columns (--columns x,y,z,...)")) << name;
    EXPECT_EQ(value_of(read_input({path}, {{}, {"x", "y", "z", "s"}})).points, 3u) << name;
  }
}

TEST_F(SourceTest, AFileGivenTwiceIsRefused) {
  const std::string mesh = write("a.vtu", hexahedron_mesh().file()), points = write("a.csv", "x,y,z,s\n0,0,0,1\n");
  for (const std::string& path : {mesh, points})
    EXPECT_THAT(error_of({path, folder_ + "/./" + std::filesystem::path(path).filename().string()}),
                HasSubstr(": is given twice"));
}

TEST_F(SourceTest, MeshesAreNoPointsOfNpyFiles) {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 4), }";
  header.resize(117, ' ');
  const std::string magic = std::string(npy_magic) + '\1' + '\0' + static_cast<char>(header.size() + 1) + '\0';
  const std::string mesh = write("x.vtu", tetrahedron_at(0).file());
  const std::string points = write("part1.npy", magic + header + '\n' + std::string(16, '\0'));
  EXPECT_THAT(error_of({folder_}), AllOf(StartsWith(folder_), HasSubstr("x.vtu")));
  EXPECT_THAT(error_of({mesh, points}), HasSubstr("a file of NumPy among meshes"));
  EXPECT_THAT(error_of({mesh}, {{}, {"x", "y", "z", "s"}}), HasSubstr("columns cannot be named"));
}

TEST_F(SourceTest, PiecesOfAMeshInAFolderAreReadOnce) {
  for (const int i : {0, 9, 10}) write(fmt::format("piece{}.vtu", i), tetrahedron_at(i).file());
  const auto starts = [&] {
    std::vector<double> x;
    auto source = value_of(open_source({folder_}, {}));
    EXPECT_FALSE(*source->bounds()) << "only reading a mesh tells";
    EXPECT_FALSE(source->point_count());
    while (auto piece = *source->next()) x.push_back(piece->points[0].x);
    return x;
  };
  EXPECT_THAT(starts(), ElementsAre(0, 9, 10));
  write("all.pvtu", vtk_file("PUnstructuredGrid", "<Piece Source=\"piece10.vtu\"/><Piece Source=\"./piece0.vtu\"/>"));
  EXPECT_THAT(starts(), ElementsAre(10, 0, 9));
}

TEST_F(SourceTest, NamesOfAnyCaseAreKnown) {
  VtuMesh mesh = hexahedron_mesh();
  write("pieces/a.vtu", mesh.file());
  for (dvec3& p : mesh.points) p.x += 1;
  write("pieces/B.VTU", mesh.file());
  for (dvec3& p : mesh.points) p.x += 1;
  write("pieces/c.Vtu", mesh.file());
  const auto pieces = value_of(read_input({folder_ + "pieces"}));
  EXPECT_EQ(pieces.pieces.size(), 3u);
  EXPECT_THAT(files_left_out({folder_ + "pieces"}), IsEmpty());
  for (const char* name : {"a.E", "a.e-s002", "a.e-s002.4.1", "a.exo.4.0", "a.GEN", "a.gen", "a.G"}) {
    const auto header = value_of(read_header(write(name, "\x89HDF\r\n\x1a\n")));
    EXPECT_EQ(header.format, InputFormat::exodus) << name;
  }
  EXPECT_EQ(read_header(write("A.CASE", "FORMAT\n"))->format, InputFormat::ensight);
  EXPECT_EQ(read_header(write("a.NPY", ""))->format, InputFormat::numpy);
  EXPECT_EQ(read_header(write("a.TSV", ""))->format, InputFormat::table);
  for (const char* name : {"a.e-s", "a-s002", "s002", "a.vtk-s1"})
    EXPECT_EQ(read_header(write(name, "x"))->format, std::nullopt) << name;
}

TEST_F(SourceTest, FormatsThatAreNotReadNameTheWayOut) {
  const std::string mesh = write("mesh.vtu", hexahedron_mesh().file());
  for (const char* name :
       {"a.xdmf", "a.h5", "a.cas.h5", "a.nc", "a.med", "a.plt", "a.frd", "a.inp", "a.NEK5000", "a.unv", "a.las"}) {
    const std::string path = write(name, "some bytes\n");
    for (const auto& inputs : {std::vector{path}, {path, mesh}, {mesh, path}})
      EXPECT_THAT(error_of(inputs), AllOf(StartsWith(path + ": files of "), HasSubstr("are not read: "))) << name;
  }
  EXPECT_THAT(error_of({write("a.bin", "some bytes\n")}), HasSubstr("its format is not known"));
  EXPECT_THAT(error_of({write("climate.nc", "CDF\001 temperature")}), HasSubstr("files of NetCDF are not read"));
  EXPECT_THAT(error_of({write("old.msh", "$NOD\n1\n1 0 0 0\n$ENDNOD\n")}), HasSubstr("Gmsh's format 1 cannot be read"));
}

TEST_F(SourceTest, TextsThatAreNotTheDataNameTheWayToIt) {
  EXPECT_THAT(error_of({write("restart.dat", std::string("\xec\x2b\x08\0\x01\0\0\0", 8))}),
              HasSubstr(": a binary solution of SU2: "));
  const std::string pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4cc3\nsize 1234\n";
  const std::string text = "x,y,z,a\n0,0,0,1\n";
  std::string little = "\xff\xfe", big = "\xfe\xff";
  for (const char c : text) little += {c, '\0'}, big += {'\0', c};
  for (const char* name : {"a.vtu", "a.vtk", "a.csv", "a.txt", "a.msh", "a.su2", "a.e", "a.bin"}) {
    EXPECT_THAT(error_of({write(name, pointer)}), HasSubstr(": a pointer of Git LFS instead of the file: ")) << name;
    for (const std::string& wide : {little, big})
      EXPECT_THAT(error_of({write(name, wide)}), HasSubstr(": a text in UTF-16: save it as UTF-8, or iconv ")) << name;
  }
}

TEST_F(SourceTest, DataThatAFolderLeavesOutIsNamed) {
  const std::string mesh = hexahedron_mesh().file();
  write("pieces/a.vtu", mesh);
  for (const char* name : {"pieces/readme.txt", "pieces/picture.png", "pieces/.hidden.h5"}) write(name, "none\n");
  write("pieces/all.pvti", vtk_file("PImageData", ""));
  EXPECT_THAT(files_left_out({folder_ + "pieces"}), IsEmpty());
  write("pieces/b.h5", "");
  write("pieces/c", mesh);
  write("pieces/d.dat", "CDF\001");
  EXPECT_THAT(files_left_out({folder_ + "pieces"}),
              ElementsAre(folder_ + "pieces/b.h5", folder_ + "pieces/c", folder_ + "pieces/d.dat"));
  EXPECT_THAT(files_left_out({folder_ + "pieces/a.vtu"}), IsEmpty());
  // A .pvd tells which files belong to it.
  write("pieces/all.PVD", vtk_file("Collection", "<DataSet timestep=\"0\" file=\"a.vtu\"/>"));
  EXPECT_THAT(files_left_out({folder_ + "pieces"}), IsEmpty());
}

TEST_F(SourceTest, BadInputIsOneClearLine) {
  EXPECT_THAT(error_of({folder_ + "none.vtu"}), AllOf(StartsWith(folder_ + "none.vtu"), HasSubstr("No such file")));
  EXPECT_THAT(error_of({folder_}), HasSubstr("a folder without files that can be read"));
  EXPECT_THAT(error_of({write("text.vtu", "This is no mesh.\n")}), HasSubstr("not a VTK file"));
  EXPECT_THAT(error_of({write("empty.vtu", "")}), HasSubstr("not a VTK file"));
  EXPECT_THAT(error_of({write("text.vtk", "This is no mesh.\n")}), HasSubstr("not a VTK file"));
  EXPECT_THAT(error_of({write("grid.xyz", "What is this?")}), HasSubstr("second of two files"));
  EXPECT_THAT(error_of({}), HasSubstr("no input"));

  VtuMesh mesh = hexahedron_mesh();
  mesh.point_data.clear();
  mesh.cell_data = {{"p", {1}}, {"T", {2}}};
  EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), "(no error)");
  EXPECT_THAT(error_of({folder_ + "a.vtu"}, {{"q"}, {}}), HasSubstr("no attribute \"q\"; there are: p, T"));
  EXPECT_THAT(error_of({write("a.vtu", VtuMesh().file())}), HasSubstr("no points"));

  mesh = hexahedron_mesh();
  for (const int bad : {8, -1, 2000000000}) {
    mesh.cells[0].points[3] = bad;
    EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), HasSubstr(fmt::format("names point {} of 8", bad)));
  }
  mesh = hexahedron_mesh();
  mesh.point_data.push_back({"s", std::vector<double>(8)});
  EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), HasSubstr("two arrays of its PointData are called \"s\""));
  mesh.point_data.back() = {"U", std::vector<double>(16), 2};
  mesh.point_data.push_back({"U[0]", std::vector<double>(8)});
  EXPECT_THAT(error_of({write("a.vtu", mesh.file())}), HasSubstr("two attributes are called \"U[0]\""));
}

TEST_F(SourceTest, MoreInOnePieceThanMemoryHoldsIsRefusedBeforeItIsRead) {
  const std::string text = replaced(hexahedron_mesh().file(), "NumberOfCells=\"1\"", "NumberOfCells=\"400000000000\"");
  EXPECT_THAT(error_of({write("large.vtu", text)}),
              AllOf(StartsWith(folder_ + "large.vtu"), HasSubstr("4e+11 cells"), HasSubstr("several pieces")));
}

TEST_F(SourceTest, EveryTruncationOfATextFileIsRefused) {
  const std::string whole = polyhedron_mesh().file();
  const std::size_t end = whole.rfind("</VTKFile>");
  for (std::size_t size = 0; size < end; ++size)
    ASSERT_NE(error_of({write("a.vtu", whole.substr(0, size))}), "(no error)") << size;
}

/// Reads a damaged file: expects an error or a consistent mesh, and no crash.
void expect_survives(const std::string& path) {
  const auto input = read_input({path});
  EXPECT_THAT(input ? path : input.error().message, StartsWith(path));
}

TEST_F(SourceTest, DamagedBytesAreSurvived) {
  const std::string text = polyhedron_mesh().file();
  std::mt19937 random(5);
  for (std::size_t at = 0; at < text.size(); ++at) {
    std::string damaged = text;
    damaged[at] =
        random() % 2 ? static_cast<char>('0' + random() % 10) : static_cast<char>(damaged[at] ^ 1 << random() % 8);
    expect_survives(write("a.vtu", damaged));
  }
}

TEST_F(SourceTest, DamagedCompressedFilesAreSurvived) {
  const std::array<PointArray, 1> arrays = {PointArray{"s", 1, {1, 2, 3, 4}}};
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::array<std::array<std::uint32_t, 4>, 1> tetrahedra = {{{0, 1, 2, 3}}};
  ASSERT_TRUE(write_vtu(folder_ + "whole.vtu", points, tetrahedra, arrays));
  const std::string whole = *read_text_file(folder_ + "whole.vtu");
  ASSERT_NE(whole.find("vtkZLibDataCompressor"), std::string::npos);
  std::mt19937 random(6);
  for (std::size_t at = 0; at < whole.size(); ++at) {
    expect_survives(write("cut.vtu", whole.substr(0, at)));
    // 'A' is zero in base64: VTK divides by the size of compressed blocks, which is then 0.
    for (const char byte : {'A', static_cast<char>(whole[at] ^ 1 << random() % 8)}) {
      std::string damaged = whole;
      damaged[at] = byte;
      expect_survives(write("flipped.vtu", damaged));
    }
  }
  EXPECT_THAT(error_of({write("a.vtu", replaced(whole, " header_type=\"UInt64\"", ""))}),
              HasSubstr("compressed array"));
}

TEST_F(SourceTest, LegacyAndStructuredFiles) {
  const std::string scalars =
      fmt::format("POINT_DATA 8\nSCALARS s float 1\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7\nVECTORS U float\n{}\n",
                  fmt::join(std::vector<int>(24, 2), " "));
  const std::string head = "# vtk DataFile Version 3.0\ntest\nASCII\n";
  const std::string lattice = "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1\n";
  const std::map<std::string, std::string> geometry = {
      {"hexahedron", "DATASET STRUCTURED_GRID\nDIMENSIONS 2 2 2\nPOINTS 8 float\n" + lattice},
      {"voxel", "DATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n"},
      {"wedge", "DATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n" + lattice +
                    "CELLS 2 14\n6 0 2 1 4 6 5\n6 1 2 3 5 6 7\nCELL_TYPES 2\n13 13\n"}};
  for (const auto& [cell, text] : geometry) {
    SCOPED_TRACE(cell);
    const auto input = value_of(read_input({write("a.vtk", head + text + scalars)}));
    EXPECT_THAT(input.attributes, ElementsAre("s", "U", "U[0]", "U[1]", "U[2]"));
    EXPECT_DOUBLE_EQ(input.volume, 1);
    EXPECT_EQ(input.census.cells.count(cell), 1u);
  }
  const auto surface = value_of(read_input(
      {write("a.vtk", head + "DATASET POLYDATA\nPOINTS 8 float\n" + lattice + "POLYGONS 1 4\n3 0 1 2\n" + scalars)}));
  EXPECT_EQ(surface.points, 8u);
  EXPECT_EQ(surface.census.without_volume, 1u);
  EXPECT_EQ(describe_no_volume(surface.census), "only surface cells (1 polygon)");
  const auto without_values = value_of(
      read_input({write("a.vtk", head + "DATASET POLYDATA\nPOINTS 8 float\n" + lattice + "POLYGONS 1 4\n3 0 1 2\n")}));
  EXPECT_THAT(without_values.attributes, ElementsAre("cell_volume"));
  EXPECT_EQ(without_values.census.surfaces, 1u);
  EXPECT_THAT(error_of({write("a.vtk", head + "DATASET STRUCTURED_GRID\nDIMENSIONS 2 2 2\nPOINTS 8 float\n0 0 0 1")}),
              StartsWith(folder_));
}

template <class T>
void put(std::string& bytes, std::initializer_list<T> values) {
  for (const T value : values) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    bytes.append(raw, sizeof(T));
  }
}

/// Two blocks of 3 x 2 x 2 and 2 x 2 x 2 points. With blanking, point 0 of the first is a hole.
struct Plot3dFiles {
  bool record_marks = false;
  bool big_endian = false;
  bool blanking = false;
  bool wide = false;
  std::string grid, solution, functions;  // two: 10 i and 10 i + 1 at point i

  template <class T>
  std::string raw(T value) const {
    std::string bytes(sizeof(T), '\0');
    std::memcpy(bytes.data(), &value, sizeof(T));
    if (big_endian) std::ranges::reverse(bytes);
    return bytes;
  }
  [[nodiscard]] std::string integer(int value) const { return raw<std::int32_t>(value); }
  [[nodiscard]] std::string real(double value) const {
    return wide ? raw<double>(value) : raw<float>(static_cast<float>(value));
  }
  [[nodiscard]] std::string record(const std::string& bytes) const {
    const std::string mark = record_marks ? integer(static_cast<int>(bytes.size())) : "";
    return mark + bytes + mark;
  }

  void make() {
    std::string dimensions;
    for (const int n : {3, 2, 2, 2, 2, 2}) dimensions += integer(n);
    grid = solution = record(integer(2)) + record(dimensions);
    std::string with_count;
    for (const int n : {3, 2, 2, 2, 2, 2, 2, 2}) with_count += integer(n);
    functions = record(integer(2)) + record(with_count);
    for (const int block : {0, 1}) {
      const int width = 3 - block;
      const int count = width * 4;
      std::string points, flow, values;
      for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < count; ++i)
          points +=
              real(std::array{i % width + 10 * block, i / width % 2, i / width / 2}[static_cast<std::size_t>(axis)]);
      for (int i = 0; blanking && i < count; ++i) points += integer(block == 0 && i == 0 ? 0 : 1);
      for (const double number : {0.5, 0.0, 1000.0, 0.0}) flow += real(number);
      for (const double value : {2.0, 3.0, 0.0, 4.0, 12.25})  // density, momentum, energy
        for (int i = 0; i < count; ++i) values += real(value);
      grid += record(points);
      solution += record(flow) + record(values);
      std::string of_block;
      for (const int function : {0, 1})
        for (int i = 0; i < count; ++i) of_block += real(10 * i + function);
      functions += record(of_block);
    }
  }
};

TEST_F(SourceTest, Plot3dOfEveryVariant) {
  for (unsigned flags = 0; flags < 16; ++flags) {
    SCOPED_TRACE(flags);
    Plot3dFiles files{(flags & 1) != 0, (flags & 2) != 0, (flags & 4) != 0, (flags & 8) != 0, "", "", ""};
    files.make();
    const auto input = value_of(read_input({write("a.xyz", files.grid), write("a.q", files.solution)}));
    EXPECT_THAT(input.attributes, ElementsAre("Density", "Momentum", "Momentum[0]", "Momentum[1]", "Momentum[2]",
                                              "StagnationEnergy", "Pressure"));
    ASSERT_EQ(input.pieces.size(), 2u);
    EXPECT_EQ(input.pieces[0].points.size(), files.blanking ? 8u : 12u)
        << "without the hole and the points that only its cell uses";
    EXPECT_EQ(input.pieces[1].points.size(), 8u);
    EXPECT_EQ(input.census.hidden, files.blanking ? 1u : 0u);
    EXPECT_NEAR(input.volume, files.blanking ? 2 : 3, 1e-12);
    EXPECT_NEAR(input.pieces[1].values[1][5], 5, 1e-6);
    // p = (gamma - 1) (e - |m|^2 / (2 rho)) = 0.4 (12.25 - 25 / 4)
    EXPECT_NEAR(input.pieces[1].values[6][5], 2.4, 1e-6);
  }
}

TEST_F(SourceTest, Plot3dFunctions) {
  for (unsigned flags = 0; flags < 16; ++flags) {
    SCOPED_TRACE(flags);
    Plot3dFiles files{(flags & 1) != 0, (flags & 2) != 0, (flags & 4) != 0, (flags & 8) != 0, "", "", ""};
    files.make();
    const std::string grid = write("a.xyz", files.grid), functions = write("a.f", files.functions);
    const auto input = value_of(read_input({grid, functions}));
    EXPECT_THAT(input.attributes, ElementsAre("f1", "f2"));
    ASSERT_EQ(input.pieces.size(), 2u);
    EXPECT_EQ(input.pieces[1].values[0][5], 50);
    EXPECT_EQ(input.pieces[1].values[1][5], 51);
    write("a.nam", "\xef\xbb\xbfMach number\r\nU ; velocity\n");
    EXPECT_THAT(value_of(read_input({grid, functions})).attributes, ElementsAre("Mach number", "U"));
    write("a.nam", "T\nT\n");
    EXPECT_THAT(error_of({grid, functions}), HasSubstr("a.nam: two functions are called \"T\""));
    write("a.nam", "T\n");
    EXPECT_THAT(error_of({grid, functions}), HasSubstr("a.nam: names 1 functions, and "));
    std::filesystem::remove(path("a.nam"));
    for (std::size_t size = 0; size < files.functions.size(); size += 3)
      EXPECT_NE(error_of({grid, write("cut.f", files.functions.substr(0, size))}), "(no error)") << size;
  }
}

// An axis may descend, and a left-handed grid is a grid. Where some of its cells are inverted, these are counted.
TEST_F(SourceTest, MirroredGridsAreNotInverted) {
  const auto image = [&](const std::string& attributes) {
    return value_of(read_input(
        {write("a.vti", vtk_file("ImageData",
                                 "<Piece Extent=\"0 2 0 1 0 1\"><PointData><DataArray type=\"Float64\" Name=\"s\" "
                                 "format=\"ascii\">0 1 2 3 4 5 6 7 8 9 10 11</DataArray></PointData></Piece>",
                                 "WholeExtent=\"0 2 0 1 0 1\" Origin=\"0 0 0\" " + attributes))}));
  };
  for (const char* attributes : {"Spacing=\"1 1 1\"", "Spacing=\"-1 1 1\"", "Spacing=\"-1 -1 -1\"",
                                 "Spacing=\"1 1 1\" Direction=\"0 1 0 1 0 0 0 0 1\""}) {
    const auto input = image(attributes);
    EXPECT_EQ(input.census.inverted, 0u) << attributes;
    EXPECT_DOUBLE_EQ(input.volume, 2) << attributes;
  }
  const auto structured = [&](const std::string& points) {
    return value_of(read_input(
        {write("a.vts", vtk_file("StructuredGrid",
                                 "<Piece Extent=\"0 3 0 1 0 1\"><PointData/><Points><DataArray type=\"Float64\" "
                                 "NumberOfComponents=\"3\" format=\"ascii\">" +
                                     points + "</DataArray></Points></Piece>",
                                 "WholeExtent=\"0 3 0 1 0 1\""))}));
  };
  const auto points_at = [](const std::vector<double>& x) {
    std::string points;
    for (int k = 0; k < 2; ++k)
      for (int j = 0; j < 2; ++j)
        for (const double value : x) points += fmt::format("{} {} {} ", value, j, k);
    return points;
  };
  EXPECT_EQ(structured(points_at({0, 1, 2, 3})).census.inverted, 0u);
  EXPECT_EQ(structured(points_at({3, 2, 1, 0})).census.inverted, 0u);
  EXPECT_EQ(structured(points_at({3, 2, 1, 4})).census.inverted, 6u) << "one cell of three goes back";
}

TEST_F(SourceTest, BadPlot3dIsOneClearLine) {
  Plot3dFiles files;
  files.blanking = true;
  files.make();
  const std::string grid = write("a.xyz", files.grid);
  const std::string solution = write("a.q", files.solution);
  const auto selected = value_of(read_input({grid, solution}, {{"Pressure"}, {}}));
  EXPECT_THAT(selected.attributes, ElementsAre("Pressure"));
  EXPECT_THAT(error_of({grid, solution}, {{"p"}, {}}), AllOf(HasSubstr("\"p\""), HasSubstr("Density")));
  EXPECT_THAT(error_of({grid, folder_ + "none.q"}), HasSubstr("No such file"));
  EXPECT_THAT(error_of({solution, grid}), HasSubstr("neither a VTK file nor a binary PLOT3D grid"));
  const std::string other = write("b.xyz", files.grid);
  EXPECT_THAT(error_of({grid, other}), AllOf(StartsWith(other), HasSubstr("not a PLOT3D solution")));
  const std::size_t whole_without_blanking = 28 + 20 * 12;
  for (std::size_t size = 0; size < files.grid.size(); ++size) {
    if (size == whole_without_blanking) continue;
    EXPECT_NE(error_of({write("cut.xyz", files.grid.substr(0, size)), solution}), "(no error)") << size;
  }
  for (std::size_t size = 0; size < files.solution.size(); ++size)
    EXPECT_NE(error_of({grid, write("cut.q", files.solution.substr(0, size))}), "(no error)") << size;
  for (std::size_t at = 0; at < 28; ++at) {
    std::string damaged = files.grid;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x11);
    EXPECT_NE(error_of({write("damaged.xyz", damaged), solution}), "(no error)") << at;
  }
}

/// A structured PLOT3D grid of one block, in single precision and big endian.
class Plot3dGrid {
 public:
  explicit Plot3dGrid(const std::string& path) : bytes_(*read_text_file(path)), n_{word(0), word(1), word(2)} {}

  [[nodiscard]] std::size_t points(std::size_t axis) const { return n_[axis]; }

  /// Whether the file has the size of such a grid, with or without blanking.
  [[nodiscard]] bool valid() const {
    return bytes_.size() == 4 * (3 + 3 * count()) || bytes_.size() == 4 * (3 + 4 * count());
  }

  [[nodiscard]] dvec3 position(const std::array<std::size_t, 3>& ijk) const {
    const std::size_t point = (ijk[2] * n_[1] + ijk[1]) * n_[0] + ijk[0];
    dvec3 p;
    for (std::size_t axis = 0; axis < 3; ++axis)
      p[static_cast<int>(axis)] = std::bit_cast<float>(word(3 + axis * count() + point));
    return p;
  }

 private:
  [[nodiscard]] std::uint32_t word(std::size_t index) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(bytes_[4 * index + i]);
    return value;
  }
  [[nodiscard]] std::size_t count() const { return n_[0] * n_[1] * n_[2]; }

  std::string bytes_;
  std::array<std::size_t, 3> n_;
};

/// Finds the volume within a structured grid's boundary by the divergence theorem. Every quadrilateral is split through
/// its corner that is lowest by x, then y, then z.
double enclosed_volume(const std::string& path) {
  const Plot3dGrid grid(path);
  if (!grid.valid()) return 0;
  const auto less = [](dvec3 a, dvec3 b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); };
  double volume_6 = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const bool far : {false, true})
      for (std::size_t i = 0; i + 1 < grid.points(u); ++i)
        for (std::size_t j = 0; j + 1 < grid.points(v); ++j) {
          std::array<dvec3, 4> corners;
          for (std::size_t corner = 0; corner < 4; ++corner) {
            std::array<std::size_t, 3> ijk{};
            ijk[axis] = far ? grid.points(axis) - 1 : 0;
            ijk[u] = i + (corner == 1 || corner == 2);
            ijk[v] = j + (corner >= 2);
            corners[corner] = grid.position(ijk);
          }
          std::ranges::rotate(corners, std::ranges::min_element(corners, less));
          for (const std::size_t k : {1, 2}) {
            const double part = glm::dot(corners[0], glm::cross(corners[k], corners[k + 1]));
            volume_6 += far ? part : -part;
          }
        }
  }
  return std::abs(volume_6) / 6;
}

TEST_F(SourceTest, RealMeshesKeepTheirVolume) {
  for (const std::string name : {"bluntfin", "post"}) {
    const std::string data = shared + "/data/" + name;
    if (!std::filesystem::exists(data + "xyz.bin")) GTEST_SKIP() << data << "xyz.bin is not there";
    const auto hexahedra = read_input({data + "xyz.bin", data + "q.bin"});
    const auto tetrahedra = read_input({data + ".vtu"});
    ASSERT_TRUE(hexahedra) << hexahedra.error().message;
    ASSERT_TRUE(tetrahedra) << tetrahedra.error().message;
    EXPECT_NEAR(hexahedra->volume / tetrahedra->volume, 1, 1e-6) << name;
    EXPECT_NEAR(hexahedra->volume / enclosed_volume(data + "xyz.bin"), 1, 1e-6) << name;
    EXPECT_EQ(hexahedra->census.inverted, 0u);
    EXPECT_EQ(hexahedra->census.not_star_shaped, 0u);
    EXPECT_EQ(hexahedra->points, tetrahedra->points);

    // The fields agree point for point: both files have the same order.
    for (const char* field : {"Pressure", "StagnationEnergy", "Momentum"}) {
      const auto column = [&](const Input& input) -> const std::vector<double>& {
        return input.pieces[0].values.at(input.index_of(field));
      };
      EXPECT_EQ(column(*hexahedra), column(*tetrahedra)) << field;
    }
  }
}

TEST_F(SourceTest, Wing) {
  const std::string path = shared + "/data/wing.vtu";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not there";
  const auto input = value_of(read_input({path}, {{"p"}, {}}));
  EXPECT_EQ(input.points, 135068u);
  EXPECT_EQ(input.census.tetrahedra, 768606u);
  EXPECT_EQ(input.census.inverted + input.census.flat + input.census.hidden, 0u);
}

}  // namespace
}  // namespace splatvol::test
