// Arrays that only some parts of an input have: pieces, files, blocks.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "builder/opening/open_source.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// A tetrahedron that begins at x, as a piece of a .vtu.
std::string piece(double x, const std::vector<VtkArray>& of_points, const std::vector<VtkArray>& of_cells = {}) {
  return tetrahedron_at(x, of_points, of_cells).piece();
}

std::string vtu(const std::string& pieces) { return vtk_file("UnstructuredGrid", pieces); }

/// A tetrahedron that begins at x, as a legacy file.
std::string legacy(double x, const std::string& data) {
  return legacy_file(
      fmt::format("UNSTRUCTURED_GRID\nPOINTS 4 double\n{0} 0 0 {1} 0 0 {0} 1 0 {0} 0 1\n"
                  "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n{2}",
                  x, x + 1, data));
}

std::vector<double> values_of(const Input& input, const std::string& attribute) {
  std::vector<double> values;
  for (const Piece& read : input.pieces) {
    const auto& of_piece = read.values.at(input.index_of(attribute));
    values.insert(values.end(), of_piece.begin(), of_piece.end());
  }
  return values;
}

MATCHER_P(AreDoubles, expected, "") {
  return std::ranges::equal(arg, expected, [](double a, double b) { return a == b || (a != a && b != b); });
}

std::vector<double> joined(std::vector<double> first, const std::vector<double>& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

const std::vector<double> one = {1, 2, 3, 4}, two = {5, 6, 7, 8}, none(4, nan);

struct PartsTest : FolderTest {
  /// Expects the arrays s, of both parts, and t, of the part that begins at 1.
  void expect_union(const std::vector<std::string>& paths) const {
    const auto input = value_of(read_input(paths));
    ASSERT_THAT(input.attributes, UnorderedElementsAre("s", "t"));
    ASSERT_EQ(input.points, 8u);
    const bool first = input.pieces[0].points[0].x == 0;
    EXPECT_THAT(values_of(input, "s"), AreDoubles(first ? joined(one, two) : joined(two, one)));
    EXPECT_THAT(values_of(input, "t"), AreDoubles(first ? joined(none, one) : joined(one, none)));
    const auto selected = value_of(read_input(paths, {{"t"}, {}}));
    EXPECT_THAT(selected.attributes, ElementsAre("t"));
    EXPECT_THAT(values_of(selected, "t"), AreDoubles(values_of(input, "t")));
    EXPECT_THAT(error_of(paths, {{"u"}, {}}), AllOf(HasSubstr("no attribute \"u\""), HasSubstr("s"), HasSubstr("t")));
  }

  void expect_union_in_both_orders(const std::string& a, const std::string& b) const {
    expect_union({path(a), path(b)});
    expect_union({path(b), path(a)});
  }
};

TEST_F(PartsTest, FilesInBothOrders) {
  write("in/a.vtu", vtu(piece(0, {{"s", one}})));
  write("in/b.vtu", vtu(piece(1, {{"s", two}, {"t", one}})));
  expect_union_in_both_orders("in/a.vtu", "in/b.vtu");
  expect_union({path("in")});
}

TEST_F(PartsTest, TheyAreTold) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}, {"U", std::vector<double>(12, 1), 3}}, {{"c", {1}}})));
  const auto source = open_source({path("a.vtu"), path("b.vtu")}, {}).value();
  EXPECT_THAT(source->attributes(), ElementsAre("s", "U", "U[0]", "U[1]", "U[2]", "c"));
  EXPECT_THAT(source->conversions(), IsEmpty());
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(source->next());
  EXPECT_THAT(source->conversions(),
              ElementsAre("c: of cells, averaged to points", "U, c: missing where a part of the input lacks it"));
}

TEST_F(PartsTest, PiecesOfAPvtuWhateverItDeclares) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}, {"t", one}})));
  for (const char* declared : {"", "<PDataArray type=\"Float64\" Name=\"s\"/>",
                               "<PDataArray type=\"Float64\" Name=\"s\"/><PDataArray type=\"Float64\" Name=\"t\"/>"})
    for (const char* pieces :
         {"<Piece Source=\"a.vtu\"/><Piece Source=\"b.vtu\"/>", "<Piece Source=\"b.vtu\"/><Piece Source=\"a.vtu\"/>"})
      expect_union({write("all.pvtu",
                          vtk_file("PUnstructuredGrid", fmt::format("<PPointData>{}</PPointData>{}", declared, pieces),
                                   "GhostLevel=\"0\""))});
}

TEST_F(PartsTest, PiecesThatAreNamedTwiceCountOnce) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}})));
  const auto expect_once = [&](const std::vector<std::string>& paths, const std::string& told) {
    SCOPED_TRACE(paths[0]);
    EXPECT_EQ(value_of(read_input(paths)).points, 8u);
    auto source = value_of(open_source(paths, {}));
    EXPECT_THAT(source->conversions(), ElementsAre(EndsWith(told)));
  };
  const std::string once = ": files that are named more than once count once: a.vtu";
  const std::string pieces = "<Piece Source=\"a.vtu\"/><Piece Source=\"b.vtu\"/><Piece Source=\"./a.vtu\"/>";
  const std::string pvtu = write("all.pvtu", vtk_file("PUnstructuredGrid", pieces, "GhostLevel=\"0\""));
  expect_once({pvtu}, "all.pvtu" + once);
  write("b.pvtu", vtk_file("PUnstructuredGrid", "<Piece Source=\"b.vtu\"/>", "GhostLevel=\"0\""));
  expect_once({write("in.vtm", vtk_file("vtkMultiBlockDataSet",
                                        "<Block index=\"0\"><DataSet index=\"0\" file=\"a.vtu\"/></Block>"
                                        "<Block index=\"1\"><DataSet index=\"0\" file=\"a.vtu\"/>"
                                        "<DataSet index=\"1\" file=\"b.pvtu\"/></Block>"))},
              "in.vtm" + once);
  expect_once({write("at.pvd", vtk_file("Collection",
                                        "<DataSet timestep=\"0\" part=\"0\" file=\"a.vtu\"/>"
                                        "<DataSet timestep=\"0\" part=\"1\" file=\"b.vtu\"/>"
                                        "<DataSet timestep=\"0\" part=\"2\" file=\"a.vtu\"/>"))},
              "at.pvd" + once);
  // A piece beside a list that names it.
  write("two.pvtu",
        vtk_file("PUnstructuredGrid", "<Piece Source=\"a.vtu\"/><Piece Source=\"b.vtu\"/>", "GhostLevel=\"0\""));
  expect_once({path("two.pvtu"), path("a.vtu")}, "the inputs" + once);
}

TEST_F(PartsTest, ArraysThatNoPieceHasAreNamed) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}, {"t", one}})));
  const std::string content =
      "<PPointData><PDataArray type=\"Float64\" Name=\"s\"/><PDataArray type=\"Float64\" Name=\"t\"/><PDataArray "
      "type=\"Float64\" Name=\"u\"/></PPointData><Piece Source=\"a.vtu\"/><Piece Source=\"b.vtu\"/>";
  const auto losses_of = [&](const std::string& file, const std::vector<std::string>& selection = {}) {
    return value_of(read_input({path(file)}, {selection})).census.losses;
  };
  write("all.pvtu", vtk_file("PUnstructuredGrid", content, "GhostLevel=\"0\""));
  EXPECT_THAT(losses_of("all.pvtu"), ElementsAre(EndsWith("all.pvtu: declares u, which no piece has")));
  EXPECT_THAT(losses_of("all.pvtu", {"t"}), IsEmpty());
  write("in.vtm", vtm_file({"all.pvtu"}));
  EXPECT_THAT(losses_of("in.vtm"), ElementsAre(EndsWith("all.pvtu: declares u, which no piece has")));
}

TEST_F(PartsTest, BlocksAtAnyDepth) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}, {"t", one}})));
  expect_union({write("flat.vtm", vtm_file({"a.vtu", "b.vtu"}))});
  write("inner.vtm", vtm_file({"b.vtu"}));
  expect_union({write("outer.vtm", vtm_file({"a.vtu", "inner.vtm"}))});
  expect_union({write("other.vtm", vtm_file({"inner.vtm", "a.vtu"}))});
}

// Pieces of one file, of a .pvtu and of a multi-piece data set are one block; each other data set is one by itself.
TEST_F(PartsTest, BlocksAreToldApartByTheirPlaces) {
  for (int i = 0; i < 8; ++i) write(fmt::format("{}.vtu", i), vtu(piece(i, {{"s", one}})));
  write("two.vtu", vtu(piece(10, {{"s", one}}) + piece(11, {{"s", one}})));
  write("all.pvtu",
        vtk_file("PUnstructuredGrid", "<Piece Source=\"0.vtu\"/><Piece Source=\"1.vtu\"/>", "GhostLevel=\"0\""));
  const auto blocks_of = [&](const std::string& type, const std::string& content) {
    std::vector<std::uint64_t> blocks;
    const auto input = value_of(read_input({write("tree.vtm", vtk_file(type, content))}));
    for (const Piece& piece : input.pieces) blocks.push_back(piece.block);
    return blocks;
  };
  const auto set = [](const std::string& file, const std::string& attributes = "") {
    return fmt::format("<DataSet {} file=\"{}.vtu\"/>", attributes, file);
  };
  const std::string multi_block = "vtkMultiBlockDataSet";
  const auto tree =
      blocks_of(multi_block, set("2") + "<DataSet index=\"1\" file=\"all.pvtu\"/>" + set("two") + "<Block name=\"a\">" +
                                 set("3", "name=\"x\"") + set("4", "name=\"x\"") + "</Block><Piece index=\"9\">" +
                                 set("5") + "<DataSet/>" + set("6") + "</Piece>" + set("7", "name=\"z\""));
  ASSERT_EQ(tree.size(), 10u);
  EXPECT_EQ(tree[1], tree[2]) << "pieces of the .pvtu";
  EXPECT_EQ(tree[3], tree[4]) << "pieces of a file";
  EXPECT_EQ(tree[7], tree[8]) << "pieces of a multi-piece data set";
  const std::set<std::uint64_t> different(tree.begin(), tree.end());
  EXPECT_EQ(different.size(), 7u);
  EXPECT_FALSE(different.contains(0));

  // By their names, where they have some: whatever stands beside them, and in whatever file.
  const auto named = [&](const std::string& first, const std::string& second) {
    return blocks_of(multi_block,
                     set("1", "index=\"0\" name=\"" + first + "\"") + set("2", "index=\"1\" name=\"" + second + "\""));
  };
  EXPECT_EQ(named("a", "b"), (std::vector{named("b", "a")[1], named("b", "a")[0]}));
  EXPECT_EQ(blocks_of(multi_block, set("5", "index=\"0\" name=\"b\"")), std::vector{named("a", "b")[1]});

  const auto partitions = blocks_of("vtkPartitionedDataSetCollection",
                                    "<Partitions index=\"0\">" + set("1") + set("2") +
                                        "</Partitions><Partitions index=\"1\">" + set("3") + "</Partitions>");
  EXPECT_EQ(partitions[0], partitions[1]);
  EXPECT_NE(partitions[0], partitions[2]);
  const auto partitioned = blocks_of("vtkPartitionedDataSet", set("1") + set("2"));
  EXPECT_EQ(partitioned[0], partitioned[1]);

  write("inner.vtm", vtk_file(multi_block, set("1", "name=\"a\"") + set("2", "name=\"b\"")));
  write("other.vtm", vtk_file(multi_block, set("3", "name=\"a\"") + set("4", "name=\"b\"")));
  const auto nested =
      blocks_of(multi_block, "<DataSet name=\"a\" file=\"inner.vtm\"/><DataSet name=\"b\" file=\"other.vtm\"/>");
  EXPECT_EQ((std::set<std::uint64_t>(nested.begin(), nested.end()).size()), 4u);

  const auto files = value_of(read_input({path("1.vtu"), path("2.vtu")}));
  for (const Piece& piece : files.pieces) EXPECT_EQ(piece.block, 0u);
}

// VTK's reader fills the arrays of the first piece by their order, whatever the others have.
TEST_F(PartsTest, PiecesOfOneFile) {
  const std::string a = piece(0, {{"s", one}}), b = piece(1, {{"s", two}, {"t", one}});
  expect_union({write("ab.vtu", vtu(a + b))});
  expect_union({write("ba.vtu", vtu(b + a))});
  expect_union({write("other_order.vtu", vtu(a + piece(1, {{"t", one}, {"s", two}})))});
  VtuMesh other_types = tetrahedron_at(1, {{"t", one, 1, "Float32"}, {"s", two, 1, "Int32"}});
  other_types.coordinate_type = "Float32";
  expect_union({write("other_types.vtu", vtu(a + other_types.piece()))});
  expect_union({write("empty_first.vtu", vtu(VtuMesh().piece() + a + b))});
  const auto none_first = value_of(read_input({write("none_first.vtu", vtu(piece(0, {}) + b))}));
  EXPECT_THAT(values_of(none_first, "s"), AreDoubles(joined(none, two)));
  // Of cells.
  const auto cells = value_of(
      read_input({write("cells.vtu", vtu(piece(0, {}, {{"s", {1}}}) + piece(1, {}, {{"t", {2}}, {"s", {3}}})))}));
  EXPECT_THAT(values_of(cells, "s"), AreDoubles(joined({1, 1, 1, 1}, {3, 3, 3, 3})));
  EXPECT_THAT(values_of(cells, "t"), AreDoubles(joined(none, {2, 2, 2, 2})));
}

TEST_F(PartsTest, PiecesOfAStructuredFileMustBeAlike) {
  const auto image = [](const std::string& first, const std::string& second) {
    return vtk_file("ImageData",
                    fmt::format("<Piece Extent=\"0 1 0 1 0 1\"><PointData>{}</PointData></Piece>"
                                "<Piece Extent=\"1 2 0 1 0 1\"><PointData>{}</PointData></Piece>",
                                first, second),
                    "WholeExtent=\"0 2 0 1 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"");
  };
  const std::vector<double> eight(8, 1);
  const std::string s = data_arrays({{"s", eight}}), t = data_arrays({{"t", eight}});
  EXPECT_EQ(error_of({write("alike.vti", image(s + t, s + t))}), "(no error)");
  for (const std::string& second : {s, t + s, s + data_arrays({{"t", eight, 1, "Float32"}}), std::string()})
    EXPECT_THAT(error_of({write("others.vti", image(s + t, second))}), HasSubstr("other arrays than the first"));
  EXPECT_THAT(error_of({write("more.vti", image(s, s + t))}), HasSubstr("other arrays than the first"));
}

TEST_F(PartsTest, LegacyFiles) {
  write("a.vtk", legacy(0, "POINT_DATA 4\nSCALARS s double\nLOOKUP_TABLE default\n1 2 3 4\n"));
  write("b.vtk", legacy(1, "POINT_DATA 4\nFIELD FieldData 2\ns 1 4 double\n5 6 7 8\nt 1 4 double\n1 2 3 4\n"));
  expect_union_in_both_orders("a.vtk", "b.vtk");
  write("b.vtu", vtu(piece(1, {{"s", two}, {"t", one}})));
  expect_union_in_both_orders("a.vtk", "b.vtu");
}

// Programs of Windows write names so.
TEST_F(PartsTest, NamesInLatin1) {
  write("a.vtk", legacy(0, "POINT_DATA 4\nSCALARS \xe9 double\nLOOKUP_TABLE default\n1 2 3 4\n"));
  write("b.vtu", vtu(piece(1, {{"\u00e9", two}})));
  for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"\u00e9"}}) {
    const auto input = value_of(read_input({path("a.vtk"), path("b.vtu")}, {selection}));
    EXPECT_THAT(input.attributes, ElementsAre("\u00e9"));
    EXPECT_THAT(values_of(input, "\u00e9"), AreDoubles(joined(one, two)));
  }
}

// Each way to write an array is known by its header alone.
TEST_F(PartsTest, SectionsOfLegacyFiles) {
  write("a.vtk", legacy(0, "POINT_DATA 4\nSCALARS s double\nLOOKUP_TABLE default\n1 2 3 4\n"));
  const std::vector<std::pair<std::string, std::string>> sections = {
      {"SCALARS Two%20Words double 2\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n", "Two Words[1]"},
      {"VECTORS V float\n1 2 3 4 5 6 7 8 9 10 11 12\n", "V[2]"},
      {"NORMALS N float\n1 0 0 1 0 0 1 0 0 1 0 0\n", "N[2]"},
      {"TENSORS T float\n" + fmt::format("{}", fmt::join(std::vector<int>(36, 1), " ")) + "\n", "T[8]"},
      {"COLOR_SCALARS C 3\n.1 .2 .3 .4 .5 .6 .1 .2 .3 .4 .5 .6\n", "C[2]"},
      {"TEXTURE_COORDINATES X 2 float\n1 2 3 4 5 6 7 8\n", "X[1]"},
      {"FIELD more 1\nF 2 4 int\n1 2 3 4 5 6 7 8\n", "F[1]"}};
  for (const auto& [section, attribute] : sections) {
    write("b.vtk", legacy(1, "POINT_DATA 4\n" + section));
    const auto input = value_of(read_input({path("a.vtk"), path("b.vtk")}));
    EXPECT_THAT(input.attributes, Contains(attribute));
    EXPECT_FALSE(std::isnan(values_of(input, attribute)[4])) << section;
  }
}

TEST_F(PartsTest, OtherNumbersOfComponentsAreRefusedByName) {
  write("a.vtu", vtu(piece(0, {{"s", one}, {"U", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}, {"U", std::vector<double>(12, 1), 3}})));
  for (const auto& paths : {std::vector{path("a.vtu"), path("b.vtu")}, std::vector{path("b.vtu"), path("a.vtu")}})
    EXPECT_THAT(error_of(paths), AllOf(HasSubstr("the array \"U\" is a "), HasSubstr("a.vtu"), HasSubstr("b.vtu"),
                                       HasSubstr("--attribute")));
  EXPECT_EQ(error_of({path("a.vtu"), path("b.vtu")}, {{"s"}, {}}), "(no error)");
  const std::string both =
      write("both.vtu", vtu(piece(0, {{"U", one}}) + piece(1, {{"U", std::vector<double>(12, 1), 3}})));
  EXPECT_THAT(error_of({both}), HasSubstr("the array \"U\" is a "));
}

TEST_F(PartsTest, TextsAreNoMissingNumbers) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", {0, 0, 0, 0}, 1, "String"}, {"t", one}})));
  EXPECT_THAT(error_of({path("a.vtu"), path("b.vtu")}), HasSubstr("b.vtu: the array \"s\" holds texts here"));
  EXPECT_THAT(error_of({path("b.vtu"), path("a.vtu")}), HasSubstr("b.vtu: the array \"s\" holds texts here"));
}

// One array, at the points of one part and in the cells of another.
TEST_F(PartsTest, AtPointsAndInCells) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {}, {{"s", {9}}})));
  const auto averaged = value_of(read_input({path("a.vtu"), path("b.vtu")}));
  EXPECT_THAT(averaged.attributes, ElementsAre("s"));
  EXPECT_THAT(values_of(averaged, "s"), AreDoubles(joined(one, {9, 9, 9, 9})));
  for (const auto& paths : {std::vector{path("a.vtu"), path("b.vtu")}, std::vector{path("b.vtu"), path("a.vtu")}})
    EXPECT_TRUE(open_source(paths, {}).value()->averages_by_piece());
}

// Where a part has both, they are two arrays in all parts, whatever is selected.
TEST_F(PartsTest, TwoArraysOfOneName) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(2, {}, {{"s", {9}}})));
  write("c.vtu", vtu(piece(4, {{"s", two}}, {{"s", {7}}})));
  std::vector<std::string> paths = {path("a.vtu"), path("b.vtu"), path("c.vtu")};
  do {
    const auto input = value_of(read_input(paths));
    EXPECT_THAT(input.attributes, ElementsAre("s", "s (cells)"));
    for (const bool selects : {false, true}) {
      const auto points = selects ? read_input(paths, {{"s"}, {}}) : input;
      const auto cells = selects ? read_input(paths, {{"s (cells)"}, {}}) : input;
      ASSERT_TRUE(points && cells);
      for (std::size_t i = 0; i < 3; ++i) {
        const double x = input.pieces[i].points[0].x;
        EXPECT_THAT(points->pieces[i].values[0], AreDoubles(x == 0 ? one : x == 2 ? none : two));
        EXPECT_THAT(cells->pieces[i].values[selects ? 0 : 1],
                    AreDoubles(x == 0 ? none : std::vector<double>(4, x == 2 ? 9 : 7)));
      }
    }
  } while (std::ranges::next_permutation(paths).found);
}

TEST_F(PartsTest, CellsOfTheirOwn) {
  write("a.vtu", vtu(piece(0, {}, {{"s", {1}}})));
  write("b.vtu", vtu(piece(1, {{"t", one}}, {{"s", {2}}, {"u", {3}}})));
  for (const bool a_first : {false, true}) {
    const auto input = value_of(read_input({path(a_first ? "a.vtu" : "b.vtu"), path(a_first ? "b.vtu" : "a.vtu")},
                                           {{}, {}, {}, CellValues::own}));
    EXPECT_THAT(input.attributes, ElementsAre("s", "u", "t"));
    const Piece &a = input.pieces[a_first ? 0 : 1], &b = input.pieces[a_first ? 1 : 0];
    EXPECT_THAT(a.values, ElementsAre(ElementsAre(1), ElementsAre(IsNan()), ElementsAre(IsNan())));
    EXPECT_THAT(b.values, ElementsAre(ElementsAre(2), ElementsAre(3), ElementsAre(2.5)));
  }
}

TEST_F(PartsTest, TheUnitOfALaterPart) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  std::string with_unit = vtu(piece(1, {{"s", two}, {"t", one}}));
  const std::string end = "</DataArray>";
  with_unit.insert(with_unit.find(end, with_unit.find("\"t\"")),
                   "<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">Pa</InformationKey>");
  write("b.vtu", with_unit);
  EXPECT_THAT(open_source({path("b.vtu"), path("a.vtu")}, {}).value()->units(), ElementsAre("", "Pa"));
  EXPECT_THAT(open_source({path("a.vtu"), path("b.vtu")}, {}).value()->units(), ElementsAre("", "Pa"));
}

TEST_F(PartsTest, ArraysThatTurnUpLaterFail) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  write("b.vtu", vtu(piece(1, {{"s", two}})));
  const auto source = open_source({path("a.vtu"), path("b.vtu")}, {}).value();
  write("b.vtu", vtu(piece(1, {{"s", two}, {"late", one}})));
  ASSERT_TRUE(source->next());
  EXPECT_THAT(message_of(source->next()),
              AllOf(HasSubstr("b.vtu: the array \"late\" turns up"), HasSubstr("--attribute")));
}

TEST_F(PartsTest, HeadersOfDamagedFilesFail) {
  write("a.vtu", vtu(piece(0, {{"s", one}})));
  const std::string whole = vtu(piece(1, {{"s", two}, {"t", one}}));
  write("b.vtu", whole.substr(0, whole.size() / 2));
  EXPECT_THAT(error_of({path("a.vtu"), path("b.vtu")}), HasSubstr("b.vtu: "));
}

TEST_F(PartsTest, Tables) {
  write("a.csv", "x,y,z,s\n0,0,0,1\n1,0,0,2\n");
  write("b.csv", "t [Pa],x,y,z\n3,0,1,0\n,1,1,0\n");
  for (const auto& paths : {std::vector{path("a.csv"), path("b.csv")}, std::vector{path("b.csv"), path("a.csv")}}) {
    const auto input = value_of(read_input(paths));
    EXPECT_THAT(input.attributes, UnorderedElementsAre("s", "t"));
    EXPECT_EQ(std::ranges::count_if(values_of(input, "s"), [](double value) { return std::isnan(value); }), 2);
    EXPECT_EQ(std::ranges::count_if(values_of(input, "t"), [](double value) { return std::isnan(value); }), 3);
    const auto source = open_source(paths, {{"t", "s"}, {}}).value();
    EXPECT_THAT(source->units(), ElementsAre("Pa", ""));
    EXPECT_THAT(source->conversions(), ElementsAre("t, s: missing where a part of the input lacks it"));
    EXPECT_THAT(error_of(paths, {{"u"}, {}}), AllOf(HasSubstr("no attribute \"u\""), HasSubstr("s"), HasSubstr("t")));
  }
  write("texts.csv", "x,y,z,s\n0,2,0,red\n");
  EXPECT_THAT(error_of({path("a.csv"), path("texts.csv")}), HasSubstr("the column \"s\" holds texts here"));
}

}  // namespace
}  // namespace splatvol::test
