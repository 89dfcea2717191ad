// Files that name other files, and meshes of Gmsh, SU2 and VTKHDF. The tests write them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <vtk_hdf5.h>

#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/opening/input_files.h"
#include "builder/sources/vtk/collections.h"
#include "builder/sources/vtk/writer.h"
#include "tests/builder/sources/hdf5/hdf5_arrays.h"
#include "tests/builder/sources/patches_of.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

// VTK's readers leak a little if they give up on a damaged file. The leak checker asks here which leaks to ignore.
extern "C" const char* __lsan_default_suppressions() { return "leak:libvtk\nleak:libhdf5"; }

namespace splatvol::test {
namespace {

using namespace ::testing;

using Tetrahedra = std::vector<std::array<std::uint32_t, 4>>;

const std::vector<dvec3> corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

double field(dvec3 p) { return 1 + 2 * p.x - p.y + 3 * p.z; }

/// The largest difference of an attribute from the field; NaN if a value is NaN.
double largest_error(const Input& input, const std::string& attribute, double factor = 1) {
  return test::largest_error(input, attribute, [&](dvec3 p) { return factor * field(p); });
}

struct FormatsTest : FolderTest {
  [[nodiscard]] std::string error_of(const std::string& name, const SourceOptions& options = {}) const {
    return test::error_of({path(name)}, options);
  }

  [[nodiscard]] std::map<std::string, std::size_t> patches_of(const std::vector<std::string>& names) const {
    std::vector<std::string> paths;
    for (const std::string& name : names) paths.push_back(path(name));
    return test::patches_of(paths, folder_);
  }

  /// Writes a tetrahedron that is moved by x, with the field times `factor` as `name`.
  void write_tetrahedron(const std::string& file, double x, const std::string& name, double factor = 1) const {
    std::filesystem::create_directories(std::filesystem::path(path(file)).parent_path());
    std::vector<dvec3> points = corners;
    PointArray array{name, 1, {}};
    for (dvec3& p : points) {
      p.x += x;
      array.values.push_back(static_cast<float>(factor * field(p)));
    }
    const Tetrahedra cells = {{0, 1, 2, 3}};
    ASSERT_TRUE(write_vtu(path(file), points, cells, std::array<PointArray, 1>{array}));
  }

  /// Whether a text ends with a section of Gmsh. A file that is cut there is whole, and has fewer views.
  static bool ends_with_section(std::string_view text) {
    while (text.ends_with('\n')) text.remove_suffix(1);
    const std::string_view last = text.substr(text.rfind('\n') + 1);
    return last == "$EndElements" || last == "$EndNodeData" || last == "$EndElementData";
  }

  /// Cuts a file at many places. Expects an error of one line that names the file, or the input as a whole.
  void expect_refused_or_equal(const std::string& name, const std::string& opened, std::size_t stride,
                               const SourceOptions& options = {}) const {
    const std::string whole = read_text_file(path(name)).value();
    const auto all = value_of(read_input({path(opened)}, options));
    std::size_t refused = 0;
    for (std::size_t bytes = 0; bytes < whole.size(); bytes += stride) {
      if (ends_with_section(whole.substr(0, bytes))) continue;
      write(name, whole.substr(0, bytes));
      const std::string message = error_of(opened, options);
      refused += message != "(no error)" ? 1 : 0;
      if (message != "(no error)") {
        // The folder's name is random: it may hold any letters.
        const std::size_t folder = message.find(folder_);
        ASSERT_NE(folder, std::string::npos) << message;
        EXPECT_EQ(message.find("0x", folder + folder_.size()), std::string::npos) << message;
        continue;
      }
      const auto input = value_of(read_input({path(opened)}, options));
      EXPECT_EQ(input.points, all.points) << bytes;
      EXPECT_EQ(input.volume, all.volume) << bytes;
      EXPECT_EQ(input.attributes, all.attributes) << bytes;
      for (std::size_t p = 0; p < input.pieces.size(); ++p) {
        EXPECT_EQ(input.pieces[p].points, all.pieces[p].points) << bytes;
        EXPECT_EQ(input.pieces[p].values, all.pieces[p].values) << bytes;
      }
    }
    EXPECT_GT(refused, 0u);
    write(name, whole);
  }
};

// Series of files, as ParaView writes them.

TEST_F(FormatsTest, SeriesInJson) {
  const auto series = [](const std::string& files) {
    return "{\"file-series-version\": \"1.0\", \"files\": [" + files + "]}\n";
  };
  write_tetrahedron("data/a.vtu", 0, "f");
  write_tetrahedron("data/b.vtu", 0, "f", 10);
  write("s.vtu.series", series(R"({"name": "data/b.vtu", "time": 1.5}, {"name": "data/a.vtu", "time": 0})"));
  for (const auto& [asked, step] : {std::pair<std::optional<double>, std::size_t>{std::nullopt, 1}, {0.6, 0}}) {
    const auto input = value_of(read_input({path("s.vtu.series")}, {{}, {}, asked}));
    ASSERT_TRUE(input.step);
    EXPECT_THAT(input.step->times, ElementsAre(0, 1.5));
    EXPECT_LT(largest_error(input, "f", step == 0 ? 1 : 10), 1e-5);
  }
  expect_series(path("s.vtu.series"), folder_, 2);
  expect_refused_or_equal("s.vtu.series", "s.vtu.series", 1);
  // A folder: the series alone, if there is one; none of several.
  EXPECT_EQ(value_of(read_input({folder_})).step->times.size(), 2u);
  std::filesystem::copy(path("s.vtu.series"), path("data/one.vtu.series"));
  std::filesystem::copy(path("s.vtu.series"), path("data/two.vtp.series"));
  std::filesystem::remove(path("data/b.vtu"));
  EXPECT_EQ(value_of(read_input({path("data")})).points, 4u);
  EXPECT_EQ(files_left_out({path("data")}).size(), 2u);
  const auto error_with = [&](const std::string& text) {
    write("bad.vtk.series", text);
    return error_of("bad.vtk.series");
  };
  EXPECT_THAT(error_with(series("")), HasSubstr("names no files"));
  EXPECT_THAT(error_with(series(R"({"name": "a.vtu"})")), HasSubstr("files[0].time"));
  EXPECT_THAT(error_with(series(R"({"name": "a.vtu", "time": 1}, {"name": "b.vtu", "time": 1})")),
              AllOf(HasSubstr("a.vtu"), HasSubstr("b.vtu, both for the time 1")));
  EXPECT_THAT(error_with("<xml/>"), HasSubstr("bad.vtk.series"));
  EXPECT_THAT(test::error_of({path("data/a.vtu"), path("s.vtu.series")}), HasSubstr("must be the only input"));
}

// Windows's editors put a mark in front of a text in UTF-8.
TEST_F(FormatsTest, ByteOrderMarks) {
  const std::string mark = "\xef\xbb\xbf";
  write("a.vtu", mark + tetrahedron_at(0, {{"s", {1, 2, 3, 4}}}).file());
  EXPECT_EQ(value_of(read_input({path("a.vtu")})).points, 4u);
  write("a.su2", mark + "NDIME= 3\nNELEM= 1\n10 0 1 2 3\nNPOIN= 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
  EXPECT_EQ(value_of(read_input({path("a.su2")})).points, 4u);
  write("a.msh", mark +
                     "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
                     "$EndNodes\n$Elements\n1\n1 4 2 0 1 1 2 3 4\n$EndElements\n");
  EXPECT_EQ(value_of(read_input({path("a.msh")})).points, 4u);
  write("s.vtu.series", mark + R"({"files": [{"name": "a.vtu", "time": 0}]})");
  EXPECT_EQ(value_of(read_input({path("s.vtu.series")})).points, 4u);
  // VTK's readers take the mark for a word.
  write("a.vtk", mark + "# vtk DataFile Version 3.0\n");
  write("a.case", mark + "FORMAT\ntype: ensight gold\n");
  for (const char* name : {"a.vtk", "a.case"}) EXPECT_THAT(error_of(name), HasSubstr("a byte order mark")) << name;
}

TEST_F(FormatsTest, GmshTagsThatAreTooLargeAreNamed) {
  write("a.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n3000000001 0 0 0\n3000000002 1 0 0\n3000000003 0 1 0\n"
        "3000000004 0 0 1\n$EndNodes\n$Elements\n1\n1 4 2 0 1 3000000001 3000000002 3000000003 3000000004\n"
        "$EndElements\n");
  EXPECT_THAT(error_of("a.msh"),
              AllOf(HasSubstr("a.msh: the number 3000000001 in the section $Nodes"), HasSubstr("below 2^31")));
}

TEST_F(FormatsTest, PiecesOfEmptyGrids) {
  const std::string empty =
      "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"><PointData></PointData><CellData></CellData><Points></Points>"
      "<Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\"></DataArray>"
      "<DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\"></DataArray>"
      "<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"></DataArray></Cells></Piece>";
  const VtuMesh tetrahedron = tetrahedron_at(0, {{"s", {1, 2, 3, 4}}});
  write("full.vtu", tetrahedron.file());
  write("empty.vtu", vtk_file("UnstructuredGrid", empty));
  for (const char* pieces : {"<Piece Source=\"empty.vtu\"/><Piece Source=\"full.vtu\"/>",
                             "<Piece Source=\"full.vtu\"/><Piece Source=\"empty.vtu\"/>"}) {
    write("all.pvtu", vtk_file("PUnstructuredGrid", pieces, "GhostLevel=\"0\""));
    EXPECT_EQ(value_of(read_input({path("all.pvtu")})).points, 4u) << pieces;
  }
  write("all.vtm", vtm_file({"empty.vtu", "full.vtu"}));
  EXPECT_EQ(value_of(read_input({path("all.vtm")})).points, 4u);
  for (const std::string& pieces : {empty + tetrahedron.piece(), tetrahedron.piece() + empty}) {
    write("pieces.vtu", vtk_file("UnstructuredGrid", pieces));
    EXPECT_EQ(value_of(read_input({path("pieces.vtu")})).points, 4u);
  }
  EXPECT_THAT(error_of("empty.vtu"), HasSubstr("no points"));

  const std::string image = "Origin=\"0 0 0\" Spacing=\"1 1 1\"";
  write("full.vti", vtk_file("ImageData",
                             "<Piece Extent=\"0 1 0 1 0 1\"><PointData><DataArray type=\"Float64\" Name=\"s\" "
                             "format=\"ascii\">0 1 2 3 4 5 6 7</DataArray></PointData></Piece>",
                             "WholeExtent=\"0 1 0 1 0 1\" " + image));
  write("empty.vti", vtk_file("ImageData", "<Piece Extent=\"0 -1 0 -1 0 -1\"><PointData></PointData></Piece>",
                              "WholeExtent=\"0 -1 0 -1 0 -1\" " + image));
  write("all.pvti", vtk_file("PImageData",
                             "<Piece Extent=\"0 -1 0 -1 0 -1\" Source=\"empty.vti\"/>"
                             "<Piece Extent=\"0 1 0 1 0 1\" Source=\"full.vti\"/>",
                             "GhostLevel=\"0\" WholeExtent=\"0 1 0 1 0 1\" " + image));
  EXPECT_EQ(value_of(read_input({path("all.pvti")})).points, 8u);
}

// VTK writes the range of an array beside it, and does not read "inf" there.
TEST_F(FormatsTest, RangesThatAreInfinite) {
  const std::string key =
      "<InformationKey name=\"L2_NORM_RANGE\" location=\"vtkDataArray\" length=\"2\"><Value index=\"0\">0</Value>"
      "<Value index=\"1\">inf</Value></InformationKey>";
  std::string file = tetrahedron_at(0, {{"s", {1, 2, 3, 4}}}).file();
  const std::size_t array = file.find("Name=\"s\""), end = file.find("</DataArray>", array);
  file.insert(end, key);
  write("a.vtu", file);
  const auto input = value_of(read_input({path("a.vtu")}));
  EXPECT_THAT(input.pieces[0].values[0], ElementsAre(1, 2, 3, 4));
}

// .pvd: two steps of two parts.

TEST_F(FormatsTest, Pvd) {
  write("series.pvd", vtk_file("Collection",
                               "<DataSet timestep=\"2.5\" group=\"\" part=\"1\" file=\"data/d.vtu\"/>\n"
                               "<DataSet timestep=\"0.5\" group=\"\" part=\"0\" file=\"data/a.vtu\"/>\n"
                               "<DataSet timestep=\"2.5\" group=\"\" part=\"0\" file=\"data/c.vtu\"/>\n"
                               "<DataSet timestep=\"0.5\" group=\"\" part=\"1\" file=\"data/b.vtu\"/>\n"));
  write_tetrahedron("data/a.vtu", 0, "f");
  write_tetrahedron("data/b.vtu", 2, "f");
  write_tetrahedron("data/c.vtu", 0, "f", 10);
  write_tetrahedron("data/d.vtu", 2, "f", 10);
  const auto steps = value_of(collection_steps(path("series.pvd")));
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[0].time, 0.5);
  EXPECT_THAT(steps[1].files, ElementsAre(path("data/c.vtu"), path("data/d.vtu")));
  for (const auto& [asked, step] : {std::pair<std::optional<double>, std::size_t>{std::nullopt, 1}, {0.6, 0}, {9, 1}}) {
    const auto input = value_of(read_input({path("series.pvd")}, {{}, {}, asked}));
    EXPECT_EQ(input.pieces.size(), 2u);
    EXPECT_EQ(input.points, 8u);
    ASSERT_TRUE(input.step);
    EXPECT_EQ(input.step->index, step);
    EXPECT_EQ(input.step->times.size(), 2u);
    EXPECT_EQ(input.step->time, step == 0 ? 0.5 : 2.5);
    EXPECT_LT(largest_error(input, "f", step == 0 ? 1 : 10), 1e-5);
    EXPECT_EQ(input.pieces[0].points[0], dvec3(0)) << "parts in order";
  }
  expect_series(path("series.pvd"), folder_, 2);
  expect_refused_or_equal("series.pvd", "series.pvd", 1);
  write_tetrahedron("z.vtu", 0, "f");
  const auto folder = value_of(read_input({folder_}, {{}, {}, 0.5}));
  EXPECT_EQ(folder.points, 8u) << "the .pvd alone";
  std::filesystem::remove(path("data/d.vtu"));
  EXPECT_THAT(error_of("series.pvd"), AllOf(StartsWith(path("series.pvd")), HasSubstr("data/d.vtu")));
  EXPECT_EQ(error_of("series.pvd", {{}, {}, 0.5}), "(no error)");
  EXPECT_THAT(test::error_of({path("data/a.vtu"), path("series.pvd")}), HasSubstr("must be the only input"));
}

// .pvti, .pvtr, .pvts: a grid of 4 x 1 x 1 cells in two pieces, with the value x at its points.
TEST_F(FormatsTest, ParallelStructuredGrids) {
  const auto piece = [&](const std::string& type, int first, int last, const std::string& whole) {
    std::vector<double> values, x, coordinates;
    for (int i = first; i <= last; ++i) x.push_back(i);
    for (const double z : {0, 1})
      for (const double y : {0, 1})
        for (const double at : x) {
          values.push_back(at);
          coordinates.insert(coordinates.end(), {at, y, z});
        }
    const std::string geometry =
        type == "StructuredGrid" ? "<Points>" + data_arrays({{"Points", coordinates, 3}}) + "</Points>"
        : type == "RectilinearGrid"
            ? "<Coordinates>" + data_arrays({{"x", x}, {"y", {0, 1}}, {"z", {0, 1}}}) + "</Coordinates>"
            : "";
    return vtk_file(type,
                    fmt::format("<Piece Extent=\"{} {} 0 1 0 1\"><PointData>{}</PointData>{}</Piece>", first, last,
                                data_arrays({{"f", values}}), geometry),
                    fmt::format("WholeExtent=\"{} 0 1 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"", whole));
  };
  const auto index = [](const std::string& type, const std::string& second, const std::string& attributes = "") {
    return vtk_file(
        "P" + type,
        "<Piece Extent=\"0 2 0 1 0 1\" Source=\"p/a\"/><Piece Extent=\"" + second + " 0 1 0 1\" Source=\"p/b\"/>",
        "WholeExtent=\"0 4 0 1 0 1\" " + attributes);
  };
  for (const std::string type : {"ImageData", "RectilinearGrid", "StructuredGrid"}) {
    SCOPED_TRACE(type);
    write("p/a", piece(type, 0, 2, "0 2"));
    write("p/b", piece(type, 2, 4, "2 4"));
    write("all.pvti", index(type, "2 4"));
    const auto input = value_of(read_input({path("all.pvti")}));
    EXPECT_EQ(input.pieces.size(), 2u);
    EXPECT_NEAR(input.volume, 4, 1e-12);
    EXPECT_LT(largest_error(input, "f", [](dvec3 p) { return p.x; }), 1e-12);
    write("all.pvti", index(type, "3 4"));
    EXPECT_THAT(error_of("all.pvti"), HasSubstr("its pieces have 3 cells, and its WholeExtent 4"));
    write("all.pvti", index(type, "1 4", "GhostLevel=\"1\""));
    EXPECT_EQ(error_of("all.pvti"), "(no error)");
    write("all.pvti", index(type == "ImageData" ? "StructuredGrid" : "ImageData", "2 4"));
    EXPECT_THAT(error_of("all.pvti"), HasSubstr("p/a is not a file of the type"));
  }
}

TEST_F(FormatsTest, DamagedPvd) {
  const auto of = [&](const std::string& body) {
    write("a.pvd", vtk_file("Collection", body));
    return error_of("a.pvd");
  };
  EXPECT_THAT(of(""), HasSubstr("names no files"));
  EXPECT_THAT(of("<DataSet timestep=\"0\"/>"), HasSubstr("a DataSet names no file"));
  EXPECT_THAT(of("<DataSet timestep=\"x\" file=\"a.vtu\"/>"), HasSubstr("timestep=\"x\" of a DataSet is not a number"));
  EXPECT_THAT(of("<DataSet timestep=\"0\" file=\"a.pvd\"/>"), HasSubstr("must be the only input"));
}

// Eleven files that stand for 16^10 files, with a link in their paths, and one piece that is named too often.
TEST_F(FormatsTest, FilesThatNameEachOtherTooOftenAreRefused) {
  write_tetrahedron("a.vtu", 0, "f");
  std::filesystem::create_directory_symlink(".", path("same"));
  write("10.vtm", vtm_file({"a.vtu"}));
  for (int i = 0; i < 10; ++i) {
    std::vector<std::string> blocks;
    for (int k = 0; k < 16; ++k) blocks.push_back(fmt::format("{}{}.vtm", k % 2 ? "same/" : "", i + 1));
    write(fmt::format("{}.vtm", i), vtm_file(blocks));
  }
  EXPECT_THAT(error_of("0.vtm"), HasSubstr("stand for 2.27e+12 files, and at most 1048576 are read"));
  std::string pieces;
  for (int i = 0; i < 1024; ++i) pieces += "<Piece Source=\"a.vtu\"/>";
  write("a.pvtu", vtk_file("PUnstructuredGrid", pieces));
  write("a.vtm", vtm_file(std::vector<std::string>(1024, "a.pvtu")));
  EXPECT_THAT(error_of("a.vtm"), HasSubstr("stand for 1.05e+06 files"));
}

// .vtm: nested blocks with different arrays, a surface and an empty block.

TEST_F(FormatsTest, Vtm) {
  write_tetrahedron("blocks/a.vtu", 0, "f");
  write_tetrahedron("blocks/deep/b.vtu", 2, "g");
  const PointArray array{"wall", 1, {1, 1, 1}};
  ASSERT_TRUE(write_vtu(path("blocks/points.vtu"), std::vector<dvec3>(corners.begin(), corners.begin() + 3), {},
                        std::array<PointArray, 1>{array}));
  write(
      "blocks/wall.vtp",
      "<VTKFile type=\"PolyData\" version=\"0.1\"><PolyData><Piece NumberOfPoints=\"3\" NumberOfPolys=\"1\"><Points>"
      "<DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0</DataArray></Points>"
      "<Polys><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2</DataArray>"
      "<DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">3</DataArray></Polys></Piece></PolyData></VTKFile>");
  write("all.vtm", vtk_file("vtkMultiBlockDataSet",
                            "<DataSet index=\"0\" file=\"blocks/a.vtu\"/><Block index=\"1\"><Block index=\"0\">"
                            "<DataSet index=\"0\" file=\"blocks/deep/b.vtu\"/></Block><DataSet index=\"1\" "
                            "file=\"blocks/wall.vtp\"/></Block><DataSet index=\"2\"/>"));
  const auto input = value_of(read_input({path("all.vtm")}));
  EXPECT_EQ(input.pieces.size(), 2u) << "no surface, no empty block";
  EXPECT_EQ(input.census.left_out, 1u) << "the triangle";
  EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "g"));
  const std::size_t f = input.index_of("f");
  EXPECT_EQ(input.pieces[0].values[f][0], 1);
  EXPECT_TRUE(std::isnan(input.pieces[1].values[f][0])) << "not in this block";
  EXPECT_TRUE(std::isnan(input.pieces[0].values[1 - f][0]));
  expect_refused_or_equal("all.vtm", "all.vtm", 3);
  const auto folder = read_input({folder_ + "blocks"}, {{"f"}, {}});
  EXPECT_FALSE(folder) << "the blocks alone differ";

  write("wall.vtm", vtm_file({"blocks/wall.vtp"}));
  EXPECT_THAT(error_of("wall.vtm"), HasSubstr("only surface cells (1 triangle); splatvol draws volumes"));
  write("gone.vtm", vtm_file({"blocks/gone.vtu"}));
  EXPECT_THAT(error_of("gone.vtm"), AllOf(StartsWith(path("gone.vtm")), HasSubstr("blocks/gone.vtu")));
  write("loop.vtm", vtm_file({"loop.vtm"}));
  EXPECT_THAT(error_of("loop.vtm"), HasSubstr("files name each other too deeply"));
}

// An array of cells that not all blocks have.
TEST_F(FormatsTest, VtmWithArraysOfCells) {
  write_tetrahedron("a.vtu", 0, "f");
  write("b.vtu", tetrahedron_at(2, {}, {{"c", {7}}}).file());
  write("all.vtm", vtm_file({"a.vtu", "b.vtu"}));
  for (const CellValues cells : {CellValues::averaged, CellValues::own}) {
    const auto input = value_of(read_input({path("all.vtm")}, {.cells = cells}));
    EXPECT_EQ(input.points, cells == CellValues::own ? 2u : 8u);
    EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "c"));
    const std::size_t c = input.index_of("c");
    EXPECT_TRUE(std::isnan(input.pieces[0].values[c][0]));
    EXPECT_EQ(input.pieces[1].values[c][0], 7);
  }
}

// Gmsh: a quadratic tetrahedron beside a linear hexahedron, in every variant of the format.

struct GmshElement {
  int type;
  std::vector<int> nodes;  // from 1
  int dimension = 3, entity = 1, group = 1;
};

/// A surface of the cube: an entity with a quadrilateral, its groups, and a tag of its own.
struct GmshSurface {
  std::vector<int> nodes;  // from 1
  std::vector<int> groups;
};

/// Numbers as text or as bytes.
class GmshText {
 public:
  GmshText(bool binary, bool version4) : binary_(binary), version4_(version4) {}
  void line(const std::string& text) { text_ += text + "\n"; }
  void integer(int value) { put(value); }
  void count(std::uint64_t value) {
    if (binary_ && !version4_)
      put(static_cast<int>(value));
    else
      put(value);
  }
  void real(double value) { put(value); }
  void end_of_line() {
    if (!binary_) text_ += "\n";
  }
  [[nodiscard]] bool binary() const { return binary_; }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  template <class T>
  void put(T value) {
    if (!binary_) {
      text_ += fmt::format("{} ", value);
      return;
    }
    const auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
    text_.append(raw.data(), raw.size());
  }
  bool binary_;
  bool version4_;
  std::string text_;
};

void put_view(GmshText& out, const std::string& section, const std::string& name, double time,
              const std::vector<int>& tags, int components, const std::function<void(int tag, GmshText& out)>& values,
              int step = 0) {
  out.line("$" + section);
  out.line(fmt::format("1\n\"{}\"\n1\n{}\n3\n{}\n{}\n{}", name, time, step, components, tags.size()));
  for (const int tag : tags) {
    out.integer(tag);
    values(tag, out);
    out.end_of_line();
  }
  if (out.binary()) out.line("");
  out.line("$End" + section);
}

struct GmshMesh {
  std::vector<dvec3> points;
  std::vector<GmshElement> elements;
  void (*put_values)(GmshText& out, const GmshMesh& mesh);
  std::string names = "1\n3 1 \"all\"\n";  // of groups
  int volume = 1;                          // its tag
  std::vector<GmshSurface> surfaces = {};  // entities, with tags from 11 on, and
  std::vector<std::vector<int>> groups_of_volumes = {{1}};
};

void put_views(GmshText& out, const GmshMesh& mesh) {
  std::vector<int> nodes;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) nodes.push_back(static_cast<int>(i) + 1);
  for (const double time : {0.0, 1.0})
    put_view(out, "NodeData", "f", time, nodes, 1, [&](int tag, GmshText& to) {
      to.real((1 + time) * field(mesh.points[static_cast<std::size_t>(tag - 1)]));
    });
  put_view(out, "ElementData", "cell", 1, {3, 4}, 1, [](int tag, GmshText& to) { to.real(tag); });
  put_view(out, "ElementNodeData", "g", 1, {3, 4}, 3, [&](int tag, GmshText& to) {
    const auto& element = mesh.elements[static_cast<std::size_t>(tag - 1)];
    to.integer(static_cast<int>(element.nodes.size()));
    for (const int node : element.nodes)
      for (const double factor : {1, 2, 3}) to.real(factor * field(mesh.points[static_cast<std::size_t>(node - 1)]));
  });
}

/// Gmsh's order of the edges of a tetrahedron.
GmshMesh gmsh_mesh() {
  GmshMesh mesh{.points = corners, .elements = {}, .put_values = put_views};
  for (const auto& [a, b] : std::array<std::array<std::size_t, 2>, 6>{{{0, 1}, {1, 2}, {2, 0}, {3, 0}, {3, 2}, {3, 1}}})
    mesh.points.push_back((corners[a] + corners[b]) / 2.0);
  for (const double z : {0.0, 1.0})
    for (const auto& [x, y] : std::array<std::array<double, 2>, 4>{{{2, 0}, {3, 0}, {3, 1}, {2, 1}}})
      mesh.points.emplace_back(x, y, z);
  mesh.elements = {
      {15, {1}}, {2, {1, 2, 3}}, {11, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}}, {5, {11, 12, 13, 14, 15, 16, 17, 18}}};
  return mesh;
}

void put_head(GmshText& out, const char* version, const GmshMesh& mesh) {
  out.line(fmt::format("$MeshFormat\n{} {} 8", version, out.binary() ? 1 : 0));
  if (out.binary()) out.integer(1), out.line("");
  out.line("$EndMeshFormat\n$PhysicalNames\n" + mesh.names + "$EndPhysicalNames");
}

std::string gmsh_2(bool binary, const GmshMesh& mesh) {
  GmshText out(binary, false);
  put_head(out, "2.2", mesh);
  out.line(fmt::format("$Nodes\n{}", mesh.points.size()));
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    out.integer(static_cast<int>(i) + 1);
    for (int axis = 0; axis < 3; ++axis) out.real(mesh.points[i][axis]);
    out.end_of_line();
  }
  out.line(binary ? "\n$EndNodes" : "$EndNodes");
  out.line(fmt::format("$Elements\n{}", mesh.elements.size()));
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    const GmshElement& element = mesh.elements[e];
    const int number = static_cast<int>(e) + 1;
    for (const int value : binary ? std::vector<int>{element.type, 1, 2, number, element.group, 1}
                                  : std::vector<int>{number, element.type, 2, element.group, 1})
      out.integer(value);
    for (const int node : element.nodes) out.integer(node);
    out.end_of_line();
  }
  out.line(binary ? "\n$EndElements" : "$EndElements");
  mesh.put_values(out, mesh);
  return out.text();
}

// Points, curves and volumes have groups with the numbers of those of surfaces.
void put_entities(GmshText& out, const GmshMesh& mesh) {
  const std::vector<GmshSurface>& surfaces = mesh.surfaces;
  const auto put_entity = [&](int tag, int numbers, const std::vector<int>& groups, const std::vector<int>& borders) {
    out.integer(tag);
    for (int i = 0; i < numbers; ++i) out.real(0.5);
    out.count(groups.size());
    for (const int group : groups) out.integer(group);
    if (numbers == 6) out.count(borders.size());
    for (const int border : borders) out.integer(border);
    out.end_of_line();
  };
  out.line("$Entities");
  for (const std::uint64_t count : {std::uint64_t{1}, std::uint64_t{1}, surfaces.size(), mesh.groups_of_volumes.size()})
    out.count(count);
  out.end_of_line();
  put_entity(1, 3, {1}, {});
  put_entity(1, 6, {2}, {1, -1});
  for (std::size_t s = 0; s < surfaces.size(); ++s)
    put_entity(static_cast<int>(s) + 11, 6, surfaces[s].groups, {1, 1, 1, 1});
  for (std::size_t v = 0; v < mesh.groups_of_volumes.size(); ++v)
    put_entity(static_cast<int>(v) + 11, 6, mesh.groups_of_volumes[v], {11, 12});
  out.line(out.binary() ? "\n$EndEntities" : "$EndEntities");
}

std::string gmsh_4(bool binary, const GmshMesh& mesh) {
  GmshText out(binary, true);
  put_head(out, "4.1", mesh);
  if (!mesh.surfaces.empty() || mesh.groups_of_volumes.size() > 1) put_entities(out, mesh);
  out.line("$Nodes");
  for (const std::uint64_t value : {std::uint64_t{1}, mesh.points.size(), std::uint64_t{1}, mesh.points.size()})
    out.count(value);
  for (const int value : {3, mesh.volume, 0}) out.integer(value);
  out.count(mesh.points.size());
  out.end_of_line();
  for (std::size_t i = 0; i < mesh.points.size(); ++i) out.count(i + 1), out.end_of_line();
  for (const dvec3& p : mesh.points) {
    for (int axis = 0; axis < 3; ++axis) out.real(p[axis]);
    out.end_of_line();
  }
  out.line(binary ? "\n$EndNodes" : "$EndNodes");
  out.line("$Elements");
  for (const std::uint64_t value : {mesh.elements.size(), mesh.elements.size(), std::uint64_t{1}, mesh.elements.size()})
    out.count(value);
  out.end_of_line();
  for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
    const GmshElement& element = mesh.elements[e];
    for (const int value : {element.dimension, element.entity, element.type}) out.integer(value);
    out.count(1);
    out.end_of_line();
    out.count(e + 1);
    for (const int node : element.nodes) out.count(static_cast<std::uint64_t>(node));
    out.end_of_line();
  }
  out.line(binary ? "\n$EndElements" : "$EndElements");
  mesh.put_values(out, mesh);
  return out.text();
}

TEST_F(FormatsTest, Gmsh) {
  for (const bool version4 : {false, true})
    for (const bool binary : {false, true}) {
      write("a.msh", version4 ? gmsh_4(binary, gmsh_mesh()) : gmsh_2(binary, gmsh_mesh()));
      const auto input = value_of(read_input({path("a.msh")}));
      EXPECT_EQ(input.points, 18u);
      EXPECT_NEAR(input.volume, 1 + 1.0 / 6, 1e-12);
      EXPECT_EQ(input.census.cells.at("quadratic tetrahedron"), 1u);
      EXPECT_EQ(input.census.cells.at("hexahedron"), 1u);
      EXPECT_EQ(input.census.cells.at("triangle"), 1u);
      EXPECT_EQ(input.census.inverted, 0u);
      EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "cell", "g", "g[0]", "g[1]", "g[2]"));
      EXPECT_LT(largest_error(input, "f", 2), 1e-12) << "the last step";
      EXPECT_LT(largest_error(input, "g[1]", 2), 1e-12);
      ASSERT_TRUE(input.step);
      EXPECT_EQ(input.step->times.size(), 2u);
      const std::size_t cell = input.index_of("cell");
      EXPECT_EQ(input.pieces[0].values[cell][0], 3);
      EXPECT_EQ(input.pieces[0].values[cell][17], 4);
      const auto first = value_of(read_input({path("a.msh")}, {{"f"}, {}, 0.2}));
      EXPECT_LT(largest_error(first, "f"), 1e-12);
      expect_series(path("a.msh"), folder_, 2);
      expect_refused_or_equal("a.msh", "a.msh", 7);
    }
}

const std::vector<dvec3> cube_corners = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                         {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};

/// The 27 nodes of a hexahedron, in Gmsh's order.
std::vector<dvec3> quadratic_points() {
  std::vector<dvec3> points = cube_corners;
  for (const auto& [a, b] : std::array<std::array<std::size_t, 2>, 12>{
           {{0, 1}, {0, 3}, {0, 4}, {1, 2}, {1, 5}, {2, 3}, {2, 6}, {3, 7}, {4, 5}, {4, 7}, {5, 6}, {6, 7}}})
    points.push_back((cube_corners[a] + cube_corners[b]) / 2.0);
  for (const dvec3& p : {dvec3(.5, .5, 0), dvec3(.5, 0, .5), dvec3(0, .5, .5), dvec3(1, .5, .5), dvec3(.5, 1, .5),
                         dvec3(.5, .5, 1), dvec3(.5)})
    points.push_back(p);
  return points;
}

TEST_F(FormatsTest, GmshOrders) {
  // The points of each cell are at the images of VTK's parametric positions, so that a wrong order changes the volume.
  const std::vector<dvec3> points = quadratic_points();
  for (const auto& [type, nodes] : {std::pair{17, 20}, {12, 27}}) {
    std::string text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n27\n";
    for (std::size_t i = 0; i < 27; ++i)
      text += fmt::format("{} {} {} {}\n", 10 * i + 5, points[i].x, points[i].y, points[i].z);
    text += fmt::format("$EndNodes\n$Elements\n1\n7 {} 0", type);
    for (int i = 0; i < nodes; ++i) text += fmt::format(" {}", 10 * i + 5);
    text += "\n$EndElements\n$NodeData\n1\n\"f\"\n1\n0\n3\n0\n1\n27\n";
    for (std::size_t i = 0; i < 27; ++i) text += fmt::format("{} {}\n", 10 * i + 5, field(points[i]));
    write("a.msh", text + "$EndNodeData\n");
    const auto input = value_of(read_input({path("a.msh")}));
    EXPECT_NEAR(input.volume, 1, 1e-12) << type;
    EXPECT_EQ(input.census.inverted, 0u) << type;
    EXPECT_LT(largest_error(input, "f"), 1e-12) << type;
  }
}

// A view that states 2^64 - 1 strings once took as many steps.
TEST_F(FormatsTest, GmshViewsWithMoreStringsThanTheFile) {
  const std::string head = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$NodeData\n";
  for (const std::string strings : {"18446744073709551615", "3"}) {
    write("a.msh", head + strings + "\n\"f\"\n");
    EXPECT_THAT(message_of(read_input({path("a.msh")})), HasSubstr("is damaged or cut off"));
  }
}

// Such files once exhausted the stack.
TEST_F(FormatsTest, RefusesDeeplyNestedXml) {
  constexpr int levels = 200'000;
  std::string text;
  for (int i = 0; i < levels; ++i) text += "<a>";
  for (int i = 0; i < levels; ++i) text += "</a>";
  for (const auto& [name, type] : {std::pair<std::string, std::string>{"a.vtu", "UnstructuredGrid"},
                                   {"a.vti", "ImageData"},
                                   {"a.pvtu", "PUnstructuredGrid"},
                                   {"a.pvd", "Collection"},
                                   {"a.vtm", "vtkMultiBlockDataSet"}}) {
    write(name, "<VTKFile type=\"" + type + "\">" + text + "</VTKFile>");
    EXPECT_THAT(error_of(name), HasSubstr("nested deeper")) << name;
  }
}

// In version 2.2 an element of two physical groups is written twice.
TEST_F(FormatsTest, RepeatedElementsOfGmshCountOnce) {
  write(
      "a.msh",
      "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n2\n"
      "1 4 2 1 1 1 2 3 4\n2 4 2 2 1 1 2 3 4\n$EndElements\n$NodeData\n1\n\"f\"\n1\n0\n3\n0\n1\n4\n1 1\n2 2\n3 3\n4 4\n"
      "$EndNodeData\n");
  const auto input = value_of(read_input({path("a.msh")}));
  EXPECT_NEAR(input.volume, 1.0 / 6, 1e-12);
  EXPECT_EQ(input.census.cells.at("tetrahedron"), 1u);
}

TEST_F(FormatsTest, DamagedGmsh) {
  const auto of = [&](const std::string& text) {
    write("a.msh", text);
    return error_of("a.msh");
  };
  const std::string format = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", nodes = "$Nodes\n1\n1 0 0 0\n$EndNodes\n";
  EXPECT_THAT(of("Not what the name says\n"), HasSubstr("does not begin with $MeshFormat"));
  EXPECT_THAT(of("$MeshFormat\n4 0 8\n$EndMeshFormat\n"), HasSubstr("format 4 cannot be read, only 2 to 2.2 and 4.1"));
  EXPECT_THAT(of(format), HasSubstr("no nodes in it"));
  EXPECT_THAT(of(format + "$Nodes\n1000000000000\n1 0 0 0\n$EndNodes\n"), HasSubstr("$Nodes is damaged or cut off"));
  EXPECT_THAT(of(format + nodes + "$Elements\n1\n1 4 0 1 2 3 4\n$EndElements\n"),
              HasSubstr("node 2 is named, but not"));
  EXPECT_THAT(of(format + nodes + "$Elements\n1\n1 999 0 1\n$EndElements\n"), HasSubstr("Gmsh's type 999"));
  EXPECT_THAT(of(format + nodes), HasSubstr("no arrays of numbers at its points, and no cells"));
}

// Gmsh's physical groups: a cube, and some of its faces.

/// The bottom is in two groups, the top in one without a name, and a side has a negative tag: it is turned round. The
/// last one has no group.
const std::vector<GmshSurface> cube_surfaces = {
    {{1, 2, 3, 4}, {1, 2}}, {{5, 6, 7, 8}, {7}}, {{1, 2, 6, 5}, {-1}}, {{2, 3, 7, 6}, {}}};

const std::string cube_names = "3\n2 1 \"wall\"\n2 2 \"floor\"\n3 1 \"all\"\n";

/// Version 2.2 repeats a face for each of its groups. In version 4.1 the surfaces have groups, and elements name their
/// surface.
GmshMesh gmsh_cube(bool version4, const std::vector<GmshSurface>& surfaces, const std::string& names = cube_names) {
  const auto put_ones = [](GmshText& out, const GmshMesh&) {
    put_view(out, "NodeData", "f", 0, {1, 2, 3, 4, 5, 6, 7, 8}, 1, [](int, GmshText& to) { to.real(1); });
  };
  GmshMesh mesh{.points = cube_corners,
                .elements = {{5, {1, 2, 3, 4, 5, 6, 7, 8}, 3, 11}},
                .put_values = put_ones,
                .names = names,
                .volume = 11,
                .surfaces = surfaces};
  for (std::size_t s = 0; s < surfaces.size(); ++s)
    for (const int group : version4 || surfaces[s].groups.empty() ? std::vector<int>{0} : surfaces[s].groups)
      mesh.elements.push_back({3, surfaces[s].nodes, 2, static_cast<int>(s) + 11, group});
  return mesh;
}

const auto its_tag = [](int tag, GmshText& to) { to.real(tag); };

/// A cube of one cell.
GmshMesh gmsh_with(void (*put_values)(GmshText& out, const GmshMesh& mesh)) {
  return {.points = cube_corners, .elements = {{5, {1, 2, 3, 4, 5, 6, 7, 8}}}, .put_values = put_values};
}

TEST_F(FormatsTest, SectionsOfAViewInGmshAreItsParts) {
  for (const bool binary : {false, true}) {
    write("a.msh", gmsh_4(binary, gmsh_with([](GmshText& out, const GmshMesh&) {
                            put_view(out, "NodeData", "T", 0, {1, 2, 3, 8}, 1, its_tag);
                            put_view(out, "NodeData", "T", 0, {4, 5, 6, 7}, 1, its_tag);
                          })));
    const Input input = value_of(read_input({path("a.msh")}));
    EXPECT_THAT(input.attributes, ElementsAre("T"));
    EXPECT_THAT(input.pieces.at(0).values.at(0), ElementsAre(1, 2, 3, 4, 5, 6, 7, 8));
    EXPECT_THAT(input.census.losses, IsEmpty());
  }
}

TEST_F(FormatsTest, NamesOfGmshInLatin1) {
  write("a.msh", gmsh_4(false, gmsh_with([](GmshText& out, const GmshMesh&) {
                          put_view(out, "NodeData", "\xe9", 0, {1, 2, 3, 4, 5, 6, 7, 8}, 1, its_tag);
                        })));
  EXPECT_THAT(value_of(read_input({path("a.msh")}, {{"\u00e9"}})).pieces.at(0).values.at(0), Contains(8));
}

TEST_F(FormatsTest, ViewsOfOneNameInGmshAreRefused) {
  const auto error_with = [&](void (*put_values)(GmshText & out, const GmshMesh& mesh)) {
    write("a.msh", gmsh_4(false, gmsh_with(put_values)));
    return test::error_of({path("a.msh")});
  };
  EXPECT_THAT(error_with([](GmshText& out, const GmshMesh&) {
                put_view(out, "NodeData", "T", 0, {1, 2, 3}, 1, its_tag);
                put_view(out, "NodeData", "T", 0, {3, 4}, 1, its_tag);
              }),
              HasSubstr("two views are called \"T\": both have values of node 3 at time 0"));
  EXPECT_THAT(error_with([](GmshText& out, const GmshMesh&) { put_view(out, "NodeData", "", 0, {1}, 1, its_tag); }),
              HasSubstr("a view has no name"));
  EXPECT_THAT(error_with([](GmshText& out, const GmshMesh&) {
                put_view(out, "NodeData", "T", 0, {1, 2, 3}, 1, its_tag);
                put_view(out, "NodeData", "T", 1, {}, 3, its_tag);
              }),
              HasSubstr("two views are called \"T\": one has 1 components, and one 3"));
  EXPECT_THAT(error_with([](GmshText& out, const GmshMesh&) {
                put_view(out, "NodeData", "T", 0, {1, 2, 3}, 1, its_tag);
                put_view(out, "ElementNodeData", "T", 0, {}, 1, its_tag);
              }),
              HasSubstr("two arrays of its points are called \"T\""));
}

TEST_F(FormatsTest, StepsOfViewsInGmshHaveTheSameAttributes) {
  // The same order at each time, and numbers of steps where all have one time.
  for (const bool one_time : {false, true}) {
    SCOPED_TRACE(one_time);
    static double second = 0;
    second = one_time ? 0 : 0.5;
    write("a.msh", gmsh_4(false, gmsh_with([](GmshText& out, const GmshMesh&) {
                            put_view(out, "NodeData", "T", 0, {1, 2, 3, 4, 5, 6, 7, 8}, 1, its_tag);
                            put_view(out, "NodeData", "p", 0, {1, 2, 3, 4, 5, 6, 7, 8}, 1, its_tag);
                            put_view(
                                out, "NodeData", "T", second, {1, 2, 3, 4, 5, 6, 7, 8}, 1,
                                [](int tag, GmshText& to) { to.real(10 * tag); }, 1);
                          })));
    for (const double time : {0.0, 1.0}) {
      const Input input = value_of(read_input({path("a.msh")}, {{}, {}, time}));
      EXPECT_THAT(input.attributes, ElementsAre("T", "p"));
      EXPECT_EQ(input.pieces.at(0).values.at(0).at(7), time == 0 ? 8 : 80);
      EXPECT_EQ(input.pieces.at(0).values.at(1).at(7), 8);
    }
  }
}

TEST_F(FormatsTest, GroupsOfGmshArePatches) {
  for (const bool version4 : {false, true})
    for (const bool binary : {false, true}) {
      const GmshMesh cube = gmsh_cube(version4, cube_surfaces);
      write("a.msh", version4 ? gmsh_4(binary, cube) : gmsh_2(binary, cube));
      EXPECT_THAT(patches_of({"a.msh"}), UnorderedElementsAre(Pair("wall", 2), Pair("floor", 2),
                                                              Pair("physical surface 7", 2), Pair("outer", 6)))
          << version4 << binary;
      const auto input = value_of(read_input({path("a.msh")}));
      EXPECT_THAT(input.pieces[0].patches, IsEmpty()) << "unless they are wanted";
      expect_refused_or_equal("a.msh", "a.msh", 7, {.patches = true});
    }
}

// A quadratic face is cut as the cell behind it is.
// Formats 2.0 and 2.1, names without quotation marks, and comments.
TEST_F(FormatsTest, OtherTextsOfGmsh) {
  const std::string whole = gmsh_2(false, gmsh_cube(false, cube_surfaces));
  const auto changed = [&](const std::vector<std::pair<std::string, std::string>>& changes) {
    std::string text = whole;
    for (const auto& [from, to] : changes)
      for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
        text.replace(at, from.size(), to);
    return text;
  };
  const std::string comments = "# made by hand\n\n$Comments\n$NoSection\n1 2 3\n$EndComments\n// more\n";
  const std::string names = "3\n1 \"wall\"\n2 \"floor\"\n3 \"all\"\n";  // without dimensions
  for (const std::string& text : {changed({{"\n2.2 ", "\n2 "}}), changed({{"\n2.2 ", "\n2.1 "}}), changed({{"\"", ""}}),
                                  changed({{"\n2.2 ", "\n2.0 "}, {cube_names, names}}), comments + whole,
                                  changed({{"$Nodes", comments + "$Nodes"}, {"$Elements", comments + "$Elements"}})}) {
    write("a.msh", text);
    EXPECT_THAT(patches_of({"a.msh"}), UnorderedElementsAre(Pair("wall", 2), Pair("floor", 2),
                                                            Pair("physical surface 7", 2), Pair("outer", 6)))
        << text;
    EXPECT_THAT(value_of(read_input({path("a.msh")})).attributes, ElementsAre("f")) << text;
  }
  for (const auto& [from, to, part] : std::vector<std::array<std::string, 3>>{
           {"\"f\"", "\"f", "$NodeData is damaged"}, {"$Nodes", "1 2 3\n$Nodes", "outside of the sections"}}) {
    write("a.msh", changed({{from, to}}));
    EXPECT_THAT(error_of("a.msh"), HasSubstr(part));
  }
}

TEST_F(FormatsTest, QuadraticGroupsOfGmshArePatches) {
  const std::vector<dvec3> points = quadratic_points();
  const auto patches = [&](const std::string& elements) {
    std::string text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n27\n";
    for (std::size_t i = 0; i < 27; ++i) text += fmt::format("{} {} {} {}\n", i, points[i].x, points[i].y, points[i].z);
    text += "$EndNodes\n$Elements\n2\n" + elements + "$EndElements\n$NodeData\n1\n\"f\"\n1\n0\n3\n0\n1\n27\n";
    for (std::size_t i = 0; i < 27; ++i) text += fmt::format("{} {}\n", i, i);
    write("a.msh", text + "$EndNodeData\n");
    return patches_of({"a.msh"});
  };
  const std::string corners_and_edges = "0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19",
                    bottom = "0 1 2 3 8 11 13 9";
  EXPECT_THAT(patches("1 17 2 1 1 " + corners_and_edges + "\n2 16 2 5 1 " + bottom + "\n"),
              UnorderedElementsAre(Pair("physical surface 5", 6), Pair("outer", 30)));
  EXPECT_THAT(patches("1 12 2 1 1 " + corners_and_edges + " 20 21 22 23 24 25 26\n2 10 2 5 1 " + bottom + " 20\n"),
              UnorderedElementsAre(Pair("physical surface 5", 8), Pair("outer", 40)));
  // A tetrahedron at a corner of the cube: nodes 0, 1, 3, 4, and its edges in Gmsh's order.
  EXPECT_THAT(patches("1 11 2 1 1 0 1 3 4 8 20 9 10 22 21\n2 9 2 5 1 0 1 3 8 20 9\n"),
              UnorderedElementsAre(Pair("physical surface 5", 4), Pair("outer", 12)));
}

// Without values, a mesh has the physical groups of its volumes. Version 4.1 names them by entities.
TEST_F(FormatsTest, MaterialsOfGmsh) {
  const auto input_of = [&](const std::string& text) {
    write("a.msh", text);
    return value_of(read_input({path("a.msh")}));
  };
  for (const bool version4 : {false, true})
    for (const bool binary : {false, true}) {
      GmshMesh mesh = gmsh_mesh();
      mesh.put_values = [](GmshText&, const GmshMesh&) {};
      const auto input_with = [&](int tetrahedron, int hexahedron) {
        mesh.groups_of_volumes = {{tetrahedron, 9}, {}};
        if (hexahedron != 0) mesh.groups_of_volumes[1] = {hexahedron};
        for (GmshElement& element : mesh.elements) {
          element.dimension = element.type == 2 ? 2 : 3;
          element.entity = element.type == 5 ? 12 : 11;
          element.group = element.type == 11 ? tetrahedron : element.type == 5 ? hexahedron : 3;
        }
        return input_of(version4 ? gmsh_4(binary, mesh) : gmsh_2(binary, mesh));
      };
      const auto input = input_with(7, 0);
      EXPECT_THAT(input.attributes, ElementsAre("material"));
      ASSERT_EQ(input.pieces.size(), 1u);
      std::vector<double> values = input.pieces[0].values.at(0);
      std::ranges::sort(values);
      values.erase(std::ranges::unique(values).begin(), values.end());
      EXPECT_THAT(values, ElementsAre(0, 7)) << "values of cells";
      // One group tells nothing, and those of surfaces are none of cells.
      EXPECT_THAT(input_with(7, 7).attributes, ElementsAre("cell_volume")) << version4 << binary;
    }
}

TEST_F(FormatsTest, DamagedGroupsOfGmsh) {
  const SourceOptions wanted{.patches = true};
  const auto error_with = [&](const std::string& names, const std::vector<GmshSurface>& surfaces) {
    write("a.msh", gmsh_4(false, gmsh_cube(true, surfaces, names)));
    return error_of("a.msh", wanted);
  };
  const std::vector<GmshSurface> bottom = {{{1, 2, 3, 4}, {1}}};
  for (const char* names : {"1\n2 1 \"wall\n", "1\n2 1\n", "1\n2 \"wall\"\n", "9\n2 1 \"wall\"\n", "wall\n"}) {
    EXPECT_THAT(error_with(names, bottom), HasSubstr("$PhysicalNames is damaged or cut off")) << names;
    EXPECT_EQ(error_of("a.msh"), "(no error)") << "nobody asks for names";
  }
  std::vector<GmshSurface> many = bottom;
  for (int group = 2; group <= 65; ++group) many[0].groups.push_back(group);
  EXPECT_THAT(error_with("0\n", many), HasSubstr("surface 11 is in 65 physical groups; 64 is the limit"));
  EXPECT_THAT(error_with("0\n", {{{1, 2, 3, 99}, {1}}}), HasSubstr("node 99 is named, but not in the file"));

  // Names that repeat are one patch, and so are numbers. A name may be empty, or that of a group that is not there.
  const auto patches_with = [&](const std::string& names, const std::vector<GmshSurface>& surfaces) {
    EXPECT_EQ(error_with(names, surfaces), "(no error)");
    return patches_of({"a.msh"});
  };
  EXPECT_THAT(
      patches_with("4\n2 1 \"a\"\n2 1 \"b\"\n2 7 \"a\"\n2 8 \"c\"\n", {{{1, 2, 3, 4}, {1, 1}}, {{5, 6, 7, 8}, {7}}}),
      UnorderedElementsAre(Pair("a", 4), Pair("outer", 8)));
  EXPECT_THAT(patches_with("1\n2 1 \"\"\n", bottom),
              UnorderedElementsAre(Pair("physical surface 1", 2), Pair("outer", 10)));
  // A face of no cell belongs to its patch, as a wall inside the mesh does.
  EXPECT_THAT(patches_with("0\n", {{{1, 2, 7, 8}, {1}}}),
              UnorderedElementsAre(Pair("physical surface 1", 2), Pair("outer", 12)));
}

// SU2: a hexahedron and a pyramid on it, with a restart file.

const std::string su2_mesh =
    "% two cells\nNDIME= 3\nNELEM= 2\n12 0 1 2 3 4 5 6 7 0\n14 4 5 6 7 8 1\nNPOIN= 9\n0 0 0 0\n1 0 0 1\n1 1 0 2\n"
    "0 1 0 3\n0 0 1 4\n1 0 1 5\n1 1 1 6\n0 1 1 7\n0.5 0.5 2 8\nNMARK= 1\nMARKER_TAG= wall\nMARKER_ELEMS= 1\n9 0 1 2 "
    "3\n";

std::string su2_restart() {
  std::string text = "\"PointID\",\"x\",\"y\",\"z\",\"f\"\n";
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},  {0, 0, 1},
                                     {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {.5, .5, 2}};
  for (std::size_t i = 0; i < points.size(); ++i)
    text +=
        fmt::format("{}, {:.7e}, {:.7e}, {:.7e}, {:.7e}\n", i, points[i].x, points[i].y, points[i].z, field(points[i]));
  return text;
}

TEST_F(FormatsTest, Su2) {
  write("a.su2", su2_mesh);
  write("restart.csv", su2_restart());
  const auto input = value_of(read_input({path("a.su2"), path("restart.csv")}));
  EXPECT_THAT(input.attributes, ElementsAre("f"));
  EXPECT_EQ(input.points, 9u);
  EXPECT_NEAR(input.volume, 1 + 1.0 / 3, 1e-12);
  EXPECT_LT(largest_error(input, "f"), 1e-6);
  EXPECT_THAT(value_of(read_input({path("a.su2")})).attributes, ElementsAre("cell_volume"));
  const auto error_with = [&](const std::string& mesh, const std::string& csv) {
    write("b.su2", mesh);
    write("b.csv", csv);
    return test::error_of({path("b.su2"), path("b.csv")});
  };
  EXPECT_THAT(error_with(su2_mesh, "x,y,z,f\n0,0,0,1\n"), HasSubstr("values of 1 points instead of the 9"));
  EXPECT_THAT(error_with(su2_mesh, "x,y,z,f\n0,0,3,1\n"), HasSubstr("not those of the points of"));
  EXPECT_THAT(error_with("NDIME= 2\nNELEM= 1\n5 0 1 2\nNPOIN= 3\n0 0\n1 0\n0 1\n", su2_restart()),
              HasSubstr("a mesh of 2 dimensions"));
  EXPECT_THAT(error_with("NZONE= 2\n", su2_restart()), HasSubstr("several zones"));
  EXPECT_THAT(error_with("NDIME= 3\nNELEM= 99999999999\n", su2_restart()), HasSubstr("line 2"));
  // Cut behind its points, a mesh is whole but for its markers.
  for (std::size_t bytes = 0; bytes < su2_mesh.size(); ++bytes) {
    const std::string message = error_with(su2_mesh.substr(0, bytes), su2_restart());
    if (bytes < su2_mesh.find("\nNMARK")) {
      EXPECT_NE(message, "(no error)") << bytes;
    }
  }
}

// Behind the mesh: boxes that deform it, the points that processes exchange, and periods.
TEST_F(FormatsTest, Su2LeavesOutOtherEntries) {
  const std::string boxes =
      "FFD_NBOX= 1\nFFD_NLEVEL= 1\nFFD_TAG= BOX\nFFD_LEVEL= 0\nFFD_DEGREE_I= 1\nFFD_CORNER_POINTS= 2\n0\t0\t0\n1 0 0\n"
      "FFD_CONTROL_POINTS= 1\n0\t0\t0\t0.0\t0.0\t0.0\nFFD_SURFACE_POINTS= 1\nwall\t1\t0.5\t0.5\t0.5\n";
  const std::string periods = "NPERIODIC= 1\nPERIODIC_INDEX= 0\n0.0 0.0 0.0\n0.0 0.0 0.0\n1.0 0.0 0.0\n";
  const std::string exchange =
      "MARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 2\nSEND_RECV= 1\n1 0 0\n1 1 0\nMARKER_TAG= SEND_RECEIVE\n"
      "MARKER_ELEMS= 1\nSEND_RECV= -1\n1 2 0\n";
  const std::string markers = replaced(su2_mesh, "NMARK= 1", "NMARK= 3");
  write("restart.csv", su2_restart());
  for (const std::string& mesh :
       {su2_mesh + boxes + periods, markers + exchange + boxes, markers + exchange + periods}) {
    write("a.su2", mesh);
    EXPECT_EQ(value_of(read_input({path("a.su2"), path("restart.csv")})).points, 9u);
    EXPECT_THAT(patches_of({"a.su2", "restart.csv"}), UnorderedElementsAre(Pair("wall", 2), Pair("outer", 12)));
  }
  write("a.su2", su2_mesh + "0 0 0\n" + boxes);
  EXPECT_THAT(test::error_of({path("a.su2"), path("restart.csv")}),
              HasSubstr("line 20 is damaged, cut off or outside"));
}

// Half of a number is no number.
TEST_F(FormatsTest, NumbersOfSu2) {
  const std::string cells = "NELEM= 1\n10 0 1 2 3\n", points = "NPOIN= 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
  const std::string csv = "x,y,z,f\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4";
  const auto input_of = [&](const std::string& mesh, const std::string& values) {
    return read_input({write("a.su2", "NDIME= 3\n" + mesh), write("a.csv", values)});
  };
  const auto error_with = [&](const std::string& mesh) { return input_of(mesh, csv + "\n").error().message; };
  EXPECT_EQ(input_of(cells + points, csv + "\n")->census.open_ends, 0u);
  EXPECT_EQ(input_of(cells + points, csv)->census.open_ends, 1u) << "of the values";
  for (const auto& [from, to] :
       {std::pair{"0 0 1\n", "0 0 1,5\n"}, {"0 0 1\n", "0 0 1.5D+00\n"}, {"10 0 1 2 3", "10 0 1 2 3,5"}}) {
    EXPECT_THAT(error_with(replaced(cells + points, from, to)), HasSubstr("is damaged, cut off or no")) << to;
  }
  const std::string last = points + cells;
  EXPECT_TRUE(input_of(last, csv));
  EXPECT_THAT(error_with(last.substr(0, last.size() - 1)), HasSubstr("no line end follows its last number"));
  EXPECT_TRUE(input_of(last.substr(0, last.size() - 1) + " 0", csv)) << "the index of the cell follows";
}

TEST_F(FormatsTest, MarkersOfSu2ArePatches) {
  write("restart.csv", su2_restart());
  const std::string mesh = su2_mesh.substr(0, su2_mesh.find("NMARK"));
  const auto patches_with = [&](const std::string& markers) {
    write("a.su2", mesh + markers);
    return patches_of({"a.su2", "restart.csv"});
  };
  EXPECT_THAT(patches_with("NMARK= 3\nMARKER_TAG= wall % of the room\nMARKER_ELEMS= 1\n9 0 1 2 3\nMARKER_TAG=tip\n"
                           "MARKER_ELEMS = 2\n5 4 5 8\n5 6 5 8 7\nMARKER_TAG= nothing\nMARKER_ELEMS= 0\n"),
              UnorderedElementsAre(Pair("wall", 2), Pair("tip", 2), Pair("outer", 10)));
  EXPECT_THAT(patches_with(""), UnorderedElementsAre(Pair("outer", 14)));
  // Markers of one name, a face of two markers, and a node and a line.
  EXPECT_THAT(patches_with("MARKER_TAG= a\nMARKER_ELEMS= 2\n9 0 1 2 3\n5 4 5 8\nMARKER_TAG= b\nMARKER_ELEMS= 3\n"
                           "5 4 5 8\n1 0\n3 0 1\nMARKER_TAG= a\nMARKER_ELEMS= 1\n5 5 6 8\n"),
              UnorderedElementsAre(Pair("a", 3), Pair("b", 1), Pair("outer", 10)));
  // The face between both cells, and one of no cell.
  EXPECT_THAT(patches_with("MARKER_TAG= inside\nMARKER_ELEMS= 1\n9 4 5 6 7\nMARKER_TAG= none\nMARKER_ELEMS= 1\n"
                           "5 0 2 8\n"),
              UnorderedElementsAre(Pair("inside", 2), Pair("none", 1), Pair("outer", 14)));
  write("a.su2", su2_mesh);
  const auto input = value_of(read_input({path("a.su2"), path("restart.csv")}));
  EXPECT_THAT(input.pieces[0].patches, IsEmpty()) << "unless they are wanted";
}

TEST_F(FormatsTest, DamagedMarkersOfSu2) {
  write("restart.csv", su2_restart());
  const std::string mesh = su2_mesh.substr(0, su2_mesh.find("NMARK"));
  const SourceOptions wanted{.patches = true};
  const auto error_with = [&](const std::string& text) {
    write("a.su2", text);
    return test::error_of({path("a.su2"), path("restart.csv")}, wanted);
  };
  const std::string wall = "MARKER_TAG= wall\nMARKER_ELEMS= 1\n";
  EXPECT_THAT(error_with(mesh + wall + "5 0 1 99\n"), HasSubstr("the marker \"wall\" names point 99 of 9"));
  EXPECT_THAT(error_with(mesh + wall + "5 0 1 99999999999999\n"), HasSubstr("names point 99999999999999 of 9"));
  EXPECT_THAT(error_with(mesh + wall + "5 0 1 -1\n"), HasSubstr("line 18 is damaged"));
  EXPECT_THAT(error_with(mesh + wall + "wall\n"), HasSubstr("line 18 is damaged"));
  EXPECT_THAT(error_with(mesh + wall), HasSubstr("no list"));
  EXPECT_THAT(error_with(mesh + "MARKER_TAG= wall\nMARKER_ELEMS= 2\n5 0 1 2\nMARKER_TAG= b\nMARKER_ELEMS= 0\n"),
              HasSubstr("too short a list"));
  EXPECT_THAT(error_with(mesh + "MARKER_TAG= wall\nMARKER_ELEMS= 99999999999\n5 0 1 2\n"), HasSubstr("no list"));
  EXPECT_THAT(error_with(mesh + "MARKER_ELEMS= 1\n5 0 1 2\n"), HasSubstr("a marker without a name"));
  EXPECT_THAT(error_with(mesh + "MARKER_TAG=\nMARKER_ELEMS= 1\n5 0 1 2\n"), HasSubstr("a marker without a name"));
  EXPECT_THAT(error_with(mesh + "NMARK= 2\n" + wall + "5 0 1 2\n"), HasSubstr("1 of its 2 markers"));
  // Cut behind NMARK, a file lacks its marker.
  for (std::size_t bytes = mesh.size() + 1; bytes < su2_mesh.size(); ++bytes)
    EXPECT_NE(error_with(su2_mesh.substr(0, bytes)), "(no error)") << bytes;
}

// VTKHDF: an unstructured grid in two partitions at two time steps, and an image.

/// Two tetrahedra at x = 0 and x = 2; at the second step the field is ten times as large.
void write_vtkhdf(const std::string& path) {
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
              root = make_group(file, "VTKHDF");
  put_type(root, "UnstructuredGrid");
  std::vector<double> points, values;
  for (const double factor : {1.0, 10.0})
    for (const double x : {0.0, 2.0})
      for (const dvec3& p : corners) {
        if (factor == 1) points.insert(points.end(), {p.x + x, p.y, p.z});
        values.push_back(factor * field(p + dvec3(x, 0, 0)));
      }
  put_array<double>(root, "Points", points, {8, 3});
  for (const char* name : {"NumberOfPoints", "NumberOfConnectivityIds"}) put_array<std::int64_t>(root, name, {4, 4});
  put_array<std::int64_t>(root, "NumberOfCells", {1, 1});
  put_array<std::int64_t>(root, "Connectivity", {0, 1, 2, 3, 0, 1, 2, 3});
  put_array<std::int64_t>(root, "Offsets", {0, 4, 0, 4});
  put_array<std::int64_t>(root, "Types", {10, 10});
  const hid_t data = make_group(root, "PointData"), cells = make_group(root, "CellData"),
              steps = make_group(root, "Steps");
  put_array<double>(data, "f", values);
  put_array<double>(cells, "c", {3, 4});
  put_array<double>(steps, "Values", {0.5, 2.5});
  put_array<std::int64_t>(steps, "NumberOfParts", {2, 2});
  for (const char* name : {"PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"})
    put_array<std::int64_t>(steps, name, {0, 0});
  const hid_t offsets = make_group(steps, "PointDataOffsets");
  put_array<std::int64_t>(offsets, "f", {0, 8});
  for (const hid_t group : {offsets, steps, cells, data, root}) H5Gclose(group);
  H5Fclose(file);
}

TEST_F(FormatsTest, VtkHdf) {
  write_vtkhdf(path("a.vtkhdf"));
  for (const auto& [asked, step] : {std::pair<std::optional<double>, std::size_t>{std::nullopt, 1}, {0.6, 0}}) {
    const auto input = value_of(read_input({path("a.vtkhdf")}, {{}, {}, asked}));
    EXPECT_EQ(input.pieces.size(), 2u);
    EXPECT_NEAR(input.volume, 1.0 / 3, 1e-12);
    EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "c"));
    EXPECT_LT(largest_error(input, "f", step == 0 ? 1 : 10), 1e-12);
    ASSERT_TRUE(input.step);
    EXPECT_EQ(input.step->index, step);
    const std::size_t c = input.index_of("c");
    EXPECT_EQ(input.pieces[0].values[c][0], 3);
    EXPECT_EQ(input.pieces[1].values[c][0], 4);
  }
  expect_series(path("a.vtkhdf"), folder_, 2);
  expect_refused_or_equal("a.vtkhdf", "a.vtkhdf", 401);
}

TEST_F(FormatsTest, NamesAndGroupsOfVtkHdf) {
  write_vtkhdf(path("a.vtkhdf"));
  hid_t file = H5Fopen(path("a.vtkhdf").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  ASSERT_GE(H5Lmove(file, "VTKHDF/CellData/c", file, "VTKHDF/CellData/\xe9", H5P_DEFAULT, H5P_DEFAULT), 0);
  H5Fclose(file);
  for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"\u00e9"}}) {
    const auto input = value_of(read_input({path("a.vtkhdf")}, {selection}));
    EXPECT_EQ(input.pieces[1].values[input.index_of("\u00e9")][0], 4) << "Latin-1";
  }
  file = H5Fopen(path("a.vtkhdf").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t data = H5Gopen2(file, "VTKHDF/PointData", H5P_DEFAULT);
  H5Gclose(make_group(data, "Inner"));
  H5Gclose(data);
  H5Fclose(file);
  EXPECT_THAT(test::error_of({path("a.vtkhdf")}), HasSubstr("\"PointData/Inner\" is a group, and no array"));
  EXPECT_THAT(value_of(read_input({path("a.vtkhdf")}, {{"f"}})).attributes, ElementsAre("f"));
}

// The arrays of each format are known by its header.
TEST_F(FormatsTest, BesideFilesWithOtherArrays) {
  write_tetrahedron("other.vtu", 20, "other");
  write_vtkhdf(path("a.vtkhdf"));
  write("text.msh", gmsh_4(false, gmsh_mesh()));
  write("binary.msh", gmsh_2(true, gmsh_mesh()));
  write("a.su2", su2_mesh);
  write("restart.csv", su2_restart());
  const std::vector<std::vector<std::string>> inputs = {
      {path("a.vtkhdf")}, {path("text.msh")}, {path("binary.msh")}, {path("a.su2"), path("restart.csv")}};
  for (const std::vector<std::string>& format : inputs) {
    const auto alone = value_of(read_input(format));
    for (const bool format_first : {true, false}) {
      std::vector<std::string> paths = format;
      paths.insert(format_first ? paths.end() : paths.begin(), path("other.vtu"));
      const auto input = value_of(read_input(paths));
      std::vector<std::string> expected = alone.attributes;
      expected.insert(format_first ? expected.end() : expected.begin(), "other");
      EXPECT_THAT(input.attributes, UnorderedElementsAreArray(expected));
      for (const Piece& piece : input.pieces)
        for (std::size_t a = 0; a < input.attributes.size(); ++a)
          EXPECT_EQ(std::isnan(piece.values[a][0]), (piece.points[0].x >= 20) != (input.attributes[a] == "other"))
              << input.attributes[a];
    }
  }
}

TEST_F(FormatsTest, VtkHdfImage) {
  const hid_t file = H5Fcreate(path("a.hdf").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t root = make_group(file, "VTKHDF");
  put_type(root, "ImageData");
  const std::array<std::int64_t, 6> extent = {0, 2, 0, 1, 0, 3};
  const std::array<double, 3> origin = {1, 0, 0}, spacing = {0.5, 1, 2};
  put_attribute(root, "WholeExtent", H5T_NATIVE_INT64, extent.data(), 6);
  put_attribute(root, "Origin", H5T_NATIVE_DOUBLE, origin.data(), 3);
  put_attribute(root, "Spacing", H5T_NATIVE_DOUBLE, spacing.data(), 3);
  const hid_t data = make_group(root, "PointData");
  std::vector<double> values;
  for (int k = 0; k < 4; ++k)
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 3; ++i) values.push_back(field({1 + 0.5 * i, j, 2 * k}));
  put_array<double>(data, "f", values, {4, 2, 3});
  for (const hid_t group : {data, root}) H5Gclose(group);
  H5Fclose(file);
  const auto input = value_of(read_input({path("a.hdf")}));
  EXPECT_EQ(input.points, 24u);
  EXPECT_NEAR(input.volume, 6, 1e-12);
  EXPECT_LT(largest_error(input, "f"), 1e-12);
  write("foreign.hdf", "Not what the name says.\n");
  EXPECT_THAT(error_of("foreign.hdf"), StartsWith(path("foreign.hdf") + ": "));
}

}  // namespace
}  // namespace splatvol::test
