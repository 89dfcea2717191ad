// Exodus files as solvers and their tools write them. The tests write them with the format's own library.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <utility>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/census_lines.h"
#include "tests/builder/sources/exodus/exodus_mesh.h"
#include "tests/builder/sources/patches_of.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

using Block = ExodusBlock;
using Mesh = ExodusMesh;

/// A cube of n^3 hexahedra, or of six tetrahedra for each of them.
Mesh cube(int n, double edge, dvec3 origin, bool tetrahedra = false) {
  Mesh mesh;
  const int side = n + 1;
  for (int k = 0; k < side; ++k)
    for (int j = 0; j < side; ++j)
      for (int i = 0; i < side; ++i) mesh.points.push_back(origin + dvec3(i, j, k) * (edge / n));
  Block block{tetrahedra ? "TETRA4" : "HEX8", {}};
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const int a = 1 + i + side * (j + side * k), up = side * side;
        const std::array<int, 8> q = {a,      a + 1,      a + 1 + side,      a + side,
                                      a + up, a + up + 1, a + up + 1 + side, a + up + side};
        if (!tetrahedra) block.cells.emplace_back(q.begin(), q.end());
        for (const auto& [b, c] : {std::pair{1, 2}, {2, 3}, {3, 7}, {7, 4}, {4, 5}, {5, 1}})
          if (tetrahedra)
            block.cells.push_back({q[0], q[static_cast<std::size_t>(b)], q[static_cast<std::size_t>(c)], q[6]});
      }
  mesh.blocks = {block};
  return mesh;
}

double cell_number(std::size_t cell, double) { return static_cast<double>(cell); }

struct ExodusTest : FolderTest {
  [[nodiscard]] Result<BuildReport> build(const std::vector<std::string>& names, bool strict = false) const {
    std::vector<std::string> paths;
    for (const std::string& name : names) paths.push_back(path(name));
    SPLATVOL_TRY_ASSIGN(source, open_source(paths, {}));
    return build_volume(*source, path("out.svol"), {.strict = strict}, [](const char*, double) {});
  }

  /// The lines of a build's report: "12 tetrahedra flat".
  [[nodiscard]] std::vector<std::string> lines_of(const std::string& name) const {
    const auto report = value_of(build({name}));
    std::vector<std::string> lines;
    for (const CensusLine& line : census_lines(report)) lines.push_back(fmt::format("{} {}", line.count, line.words));
    return lines;
  }

  [[nodiscard]] std::string strict_error_of(const std::string& name) const {
    const auto report = build({name}, true);
    return report ? "(no error)" : report.error().message;
  }

  /// Replaces bytes of a file by as many others.
  void replace(const std::string& name, const std::string& from, const std::string& to) const {
    std::string bytes = read_text_file(path(name)).value();
    const std::size_t at = bytes.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    write(name, bytes.replace(at, from.size(), to));
  }
};

// Coordinates of a country's map, where single precision has steps of half a unit.
const dvec3 far_away(5e5, 4.5e6, 0);

TEST_F(ExodusTest, KeepsCoordinatesOfDoublePrecision) {
  for (const bool tetrahedra : {false, true})
    for (const int mode : {EX_CLOBBER, EX_CLOBBER | EX_NETCDF4}) {
      Mesh mesh = cube(6, 1.2, far_away, tetrahedra);
      mesh.mode = mode;
      mesh.write(path("mesh.e"));
      const auto input = value_of(read_input({path("mesh.e")}));
      EXPECT_NEAR(input.volume, 1.728, 1e-6);
      EXPECT_EQ(input.census.flat, 0u);
      ASSERT_EQ(input.points, mesh.points.size());
      for (const dvec3& p : input.pieces[0].points) EXPECT_THAT(mesh.points, Contains(p)) << "to the last bit";
      EXPECT_EQ(strict_error_of("mesh.e"), "(no error)");
    }
}

// The map of a file names its points otherwise. A point that no cell uses goes.
TEST_F(ExodusTest, KeepsCoordinatesWhateverItsPointsAreCalled) {
  Mesh mesh = cube(3, 1.2, far_away);
  mesh.points.insert(mesh.points.begin(), dvec3(0));
  for (auto& cell : mesh.blocks[0].cells)
    for (int& point : cell) ++point;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) mesh.node_numbers.push_back(1000 - 7 * static_cast<int>(i));
  mesh.write(path("mesh.e"));
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_NEAR(input.volume, 1.728, 1e-6);
  EXPECT_EQ(input.points, mesh.points.size() - 1);
  for (std::size_t i = 0; i < input.points; ++i)
    EXPECT_EQ(input.pieces[0].values[0][i], field(input.pieces[0].points[i], 2));
}

TEST_F(ExodusTest, AddsDisplacementsInDoublePrecision) {
  Mesh mesh = cube(6, 1.2, far_away);
  for (const char* axis : {"x", "y", "z"})
    mesh.nodal.emplace_back(std::string("displ_") + axis, [](dvec3, double time) { return 0.125 * time; });
  mesh.write(path("mesh.e"));
  for (const double time : times) {
    const auto input = value_of(read_input({path("mesh.e")}, {{"f"}, {}, time}));
    EXPECT_NEAR(input.volume, 1.728, 1e-6);
    EXPECT_EQ(input.pieces[0].points[0], mesh.points[0] + 0.125 * time);
  }
}

/// Adds a vector of the points; its components are all of this size.
void add_vector(Mesh& mesh, const std::string& name, double size) {
  for (const char* axis : {"x", "y", "z"}) mesh.nodal.emplace_back(name + axis, [=](dvec3, double) { return size; });
}

// VTK's reader takes all that begins with "dis".
TEST_F(ExodusTest, OnlyDisplacementsMovePoints) {
  struct Case {
    std::vector<std::string> vectors;
    std::size_t moving;  // the number of vectors: none
    std::string told;
  };
  for (const auto& [vectors, moving, told] :
       {Case{{"discharge_", "dissipation", "dispersion_", "displaced"}, 4, ""}, Case{{"disp_"}, 0, "disp_"},
        Case{{"DISPL"}, 0, "DISPL"}, Case{{"disp_", "Displacement_", "displ_"}, 1, "Displacement_"}}) {
    Mesh mesh = cube(2, 1, dvec3(0));
    for (std::size_t v = 0; v < vectors.size(); ++v) add_vector(mesh, vectors[v], static_cast<double>(v + 1));
    mesh.write(path("mesh.e"));
    const double moved = moving < vectors.size() ? static_cast<double>(moving + 1) : 0;
    SCOPED_TRACE(vectors[0]);
    for (const bool displacements : {true, false}) {
      SourceOptions options{.displacements = displacements};
      const auto input = value_of(read_input({path("mesh.e")}, options));
      EXPECT_EQ(input.pieces.at(0).points[0], dvec3(displacements ? moved : 0));
      auto source = value_of(open_source({path("mesh.e")}, options));
      EXPECT_THAT(source->conversions(),
                  displacements && !told.empty()
                      ? Matcher<std::vector<std::string>>(ElementsAre(HasSubstr(told + ": displacements, by which")))
                      : Matcher<std::vector<std::string>>(IsEmpty()));
    }
    // The vector need not be selected.
    EXPECT_EQ(value_of(read_input({path("mesh.e")}, {{"f"}})).pieces.at(0).points[0], dvec3(moved));
  }
}

// As long as no step is written, there are no values.
TEST_F(ExodusTest, WithoutStepsItsVariablesAreMissing) {
  for (const int mode : {EX_CLOBBER, EX_CLOBBER | EX_NETCDF4}) {
    Mesh mesh = cube(2, 1, dvec3(0));
    mesh.of_cells = {{"g", [](std::size_t, double) { return 1.0; }}};
    add_vector(mesh, "disp_", 1);
    mesh.steps = 0;
    mesh.mode = mode;
    mesh.write(path("mesh.e"));
    const auto input = value_of(read_input({path("mesh.e")}));
    EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "g", "disp_", "disp_[0]", "disp_[1]", "disp_[2]"));
    EXPECT_NEAR(input.volume, 1, 1e-12);
    for (const auto& values : input.pieces.at(0).values) EXPECT_THAT(values, Each(IsNan()));
    EXPECT_THAT(input.census.losses, IsEmpty());
    auto source = value_of(open_source({path("mesh.e")}, {}));
    while (value_of(source->next())) {
    }
    EXPECT_THAT(source->conversions(), ElementsAre("f, disp_, g: missing, as the file has no time step yet", _));
    EXPECT_THAT(source->conversions().at(1), StartsWith("g: of cells, averaged"));
    const auto selected = value_of(read_input({path("mesh.e")}, {{"g"}}));
    EXPECT_THAT(selected.attributes, ElementsAre("g"));
    EXPECT_EQ(value_of(open_source({path("mesh.e")}, {{"g"}}))->conversions().at(0),
              "g: missing, as the file has no time step yet");
  }
}

TEST_F(ExodusTest, NamesOfOtherAlphabets) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.nodal.emplace_back("\u00e9", field);
  mesh.nodal.emplace_back("\u6e29\u5ea6", field);
  mesh.nodal.emplace_back("\xe9_1", field);  // Latin-1
  mesh.of_cells = {{"\u00f1", [](std::size_t cell, double) { return static_cast<double>(cell); }}};
  mesh.write(path("mesh.e"));
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_THAT(input.attributes, ElementsAre("f", "\u00e9", "\u6e29\u5ea6", "\u00e9_1", "\u00f1"));
  EXPECT_EQ(input.pieces.at(0).values.at(1), input.pieces.at(0).values.at(0));
  EXPECT_THAT(value_of(read_input({path("mesh.e")}, {{"\u00f1"}})).attributes, ElementsAre("\u00f1"));
}

TEST_F(ExodusTest, VectorsOfOtherAlphabets) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.nodal.clear();
  add_vector(mesh, "\u00fc_", 1);
  add_vector(mesh, "\u00f6_", 2);
  mesh.write(path("mesh.e"));
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_THAT(input.attributes, UnorderedElementsAre("\u00fc_", "\u00fc_[0]", "\u00fc_[1]", "\u00fc_[2]", "\u00f6_",
                                                     "\u00f6_[0]", "\u00f6_[1]", "\u00f6_[2]"));
  for (const double value : input.pieces.at(0).values.at(input.index_of("\u00f6_[0]"))) EXPECT_EQ(value, 2);
}

TEST_F(ExodusTest, VariablesOfOneNameAreRefused) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.nodal.emplace_back("f", field);
  mesh.write(path("mesh.e"));
  EXPECT_THAT(error_of({path("mesh.e")}), HasSubstr("two arrays of its points are called \"f\""));
}

TEST_F(ExodusTest, PatchesFitCellsOfDoublePrecision) {
  Mesh mesh = cube(3, 1.2, far_away);
  mesh.side_sets = {{"lid", {}}};
  for (int cell = 19; cell <= 27; ++cell) mesh.side_sets[0].sides.emplace_back(cell, 6);
  mesh.write(path("mesh.e"));
  EXPECT_THAT(patches_of({path("mesh.e")}, folder_, {}), UnorderedElementsAre(Pair("lid", 18), Pair("outer", 90)));
}

// Whatever single precision did to its cells, the file has them so.
TEST_F(ExodusTest, CoordinatesOfSinglePrecisionStayAsTheyAre) {
  Mesh mesh = cube(6, 1.2, far_away);
  mesh.real_bytes = 4;
  mesh.write(path("mesh.e"));
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_GT(input.census.flat, 0u);
  for (const dvec3& p : input.pieces[0].points)
    EXPECT_EQ(p, dvec3(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)));
  EXPECT_THAT(strict_error_of("mesh.e"), Not(HasSubstr("single precision")));
}

// VTK's reader returns leftover memory for them.
TEST_F(ExodusTest, VariablesWithoutValuesAreMissing) {
  Mesh mesh = cube(2, 1, dvec3(0));
  for (const char* name : {"g", "u_x", "u_y", "u_z"}) mesh.nodal.emplace_back(name, field);
  mesh.of_cells = {{"p", cell_number}, {"q", cell_number}};
  mesh.write(path("mesh.e"));
  replace("mesh.e", "vals_nod_var2", "gone_nod_var2");          // g
  replace("mesh.e", "vals_nod_var4", "gone_nod_var4");          // the second component of u
  replace("mesh.e", "vals_elem_var2eb1", "gone_elem_var2eb1");  // q
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "g", "u_", "u_[0]", "u_[1]", "u_[2]", "p", "q"));
  for (const char* name : {"g", "u_", "u_[1]", "q"})
    for (const double value : input.pieces[0].values.at(input.index_of(name))) EXPECT_TRUE(std::isnan(value)) << name;
  for (const char* name : {"f", "u_[0]", "u_[2]"})
    for (std::size_t i = 0; i < input.points; ++i)
      EXPECT_EQ(input.pieces[0].values.at(input.index_of(name))[i], field(input.pieces[0].points[i], 2)) << name;
  for (const double value : input.pieces[0].values.at(input.index_of("p"))) EXPECT_FALSE(std::isnan(value));
  EXPECT_THAT(lines_of("mesh.e"), AllOf(Contains("27 missing values: g"), Not(Contains(HasSubstr("values: f")))));
  EXPECT_THAT(input.census.losses, ElementsAre("g: declared, and the file has no values of it",
                                               "u_: declared, and the file has no values of it"));
}

// VTK's reader crashes.
TEST_F(ExodusTest, VectorsOfSomeComponentsAreRefused) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.of_cells = {{"u_x", cell_number}, {"u_y", cell_number}, {"u_z", cell_number}, {"q", cell_number}};
  mesh.write(path("mesh.e"));
  replace("mesh.e", "vals_elem_var2eb1", "gone_elem_var2eb1");
  EXPECT_THAT(error_of({path("mesh.e")}),
              HasSubstr("block 10 has values of 2 of the 3 components of u_: choose others"));
  EXPECT_THAT(value_of(read_input({path("mesh.e")}, {{"q"}})).attributes, ElementsAre("q"));
}

/// Opens a file of NetCDF, so that it can be changed.
int open_netcdf(const std::string& path) {
  int file = -1;
  EXPECT_EQ(nc_open(path.c_str(), NC_WRITE, &file), NC_NOERR);
  EXPECT_EQ(nc_redef(file), NC_NOERR);
  return file;
}

int dimension_of(int file, const char* name) {
  int dimension = -1;
  EXPECT_EQ(nc_inq_dimid(file, name, &dimension), NC_NOERR);
  return dimension;
}

// Files of today have an array for each variable. One array for all, as older files have it, is not looked at.
TEST_F(ExodusTest, VariablesInTheArrayOfAnOlderFileAreMissing) {
  cube(2, 1, dvec3(0)).write(path("mesh.e"));
  const int file = open_netcdf(path("mesh.e"));
  int variable = -1;
  ASSERT_EQ(nc_inq_varid(file, "vals_nod_var1", &variable), NC_NOERR);
  ASSERT_EQ(nc_rename_var(file, variable, "vals_nod_var"), NC_NOERR);
  ASSERT_EQ(nc_close(file), NC_NOERR);
  const auto input = value_of(read_input({path("mesh.e")}));
  for (const double value : input.pieces[0].values[0]) EXPECT_TRUE(std::isnan(value));
}

// The coordinates of all axes, and the values of all variables, lie in one array each.
TEST_F(ExodusTest, OlderFilesAreRead) {
  for (const nc_type type : {NC_DOUBLE, NC_FLOAT}) {
    const Mesh mesh = cube(6, 1.2, far_away);
    mesh.write(path("mesh.e"));
    const int file = open_netcdf(path("mesh.e")), model = 0;
    nc_put_att_int(file, NC_GLOBAL, "file_size", NC_INT, 1, &model);
    const std::array<int, 2> axes = {dimension_of(file, "num_dim"), dimension_of(file, "num_nodes")};
    const std::array<int, 3> of_steps = {dimension_of(file, "time_step"), dimension_of(file, "num_nod_var"), axes[1]};
    int coordinates = -1, values = -1, axis_x = -1;
    ASSERT_EQ(nc_def_var(file, "coord", type, 2, axes.data(), &coordinates), NC_NOERR);
    ASSERT_EQ(nc_def_var(file, "vals_nod_var", NC_DOUBLE, 3, of_steps.data(), &values), NC_NOERR);
    nc_inq_varid(file, "coordx", &axis_x);
    nc_rename_var(file, axis_x, "gone");
    ASSERT_EQ(nc_enddef(file), NC_NOERR);
    std::vector<double> all, steps;
    for (int axis = 0; axis < 3; ++axis)
      for (const dvec3& p : mesh.points) all.push_back(p[axis]);
    for (const double time : times)
      for (const dvec3& p : mesh.points) steps.push_back(field(p, time));
    const std::array<std::size_t, 3> first{}, count = {times.size(), 1, mesh.points.size()};
    ASSERT_EQ(nc_put_var_double(file, coordinates, all.data()), NC_NOERR);
    ASSERT_EQ(nc_put_vara_double(file, values, first.data(), count.data(), steps.data()), NC_NOERR);
    ASSERT_EQ(nc_close(file), NC_NOERR);
    const auto input = value_of(read_input({path("mesh.e")}));
    ASSERT_EQ(input.points, mesh.points.size());
    EXPECT_EQ(input.census.flat > 0, type == NC_FLOAT);
    EXPECT_THAT(input.pieces[0].values[0], Contains(field(mesh.points.back(), 2)));
  }
}

Block cells_of(const std::string& type, int nodes) {
  Block block{type, {{}, {}}};
  for (int i = 0; i < 2 * nodes; ++i) block.cells[static_cast<std::size_t>(i / nodes)].push_back(i + 1);
  return block;
}

// Points in no order: only the number of nodes is of interest.
Mesh mesh_of(const Block& block) {
  Mesh mesh;
  for (const auto& cell : block.cells)
    for (const int point : cell) mesh.points.emplace_back(std::sin(point), std::cos(3 * point), std::sin(5 * point));
  mesh.blocks = {block};
  return mesh;
}

// VTK's reader takes the first nodes of such cells, and those of all cells but the first from wrong places.
TEST_F(ExodusTest, CellsOfWhichNodesWouldBeLostAreRefused) {
  const std::vector<std::pair<std::string, int>> types = {
      {"TETRA8", 8},     {"TETRA11", 11},   {"TETRA14", 14},   {"tetra", 14},   {"TETRA15", 15},
      {"HEX9", 9},       {"HEX12", 12},     {"HEX16", 16},     {"HEX21", 21},   {"HEX", 22},
      {"HEX26", 26},     {"WEDGE12", 12},   {"WEDGE16", 16},   {"WEDGE20", 20}, {"WEDGE21", 21},
      {"PYRAMID14", 14}, {"PYRAMID18", 18}, {"PYRAMID19", 19}, {"BEAM4", 4}};
  for (const auto& [type, nodes] : types) {
    mesh_of(cells_of(type, nodes)).write(path("mesh.e"));
    EXPECT_THAT(error_of({path("mesh.e")}), AllOf(StartsWith(path("mesh.e") + ": "), Not(HasSubstr("(no error)"))))
        << type;
  }
  mesh_of(cells_of("TETRA14", 14)).write(path("mesh.e"));
  EXPECT_THAT(
      error_of({path("mesh.e")}),
      HasSubstr("Exodus: cells of block 10 have 14 nodes (TETRA14), of which VTK's reader would take 4: save them"));
}

TEST_F(ExodusTest, CellsOfAllNodesAreRead) {
  const std::vector<std::pair<std::string, int>> types = {
      {"TETRA", 4}, {"TETRA10", 10}, {"HEX8", 8},     {"HEX20", 20},   {"HEX27", 27},
      {"WEDGE", 6}, {"WEDGE15", 15}, {"WEDGE18", 18}, {"PYRAMID5", 5}, {"PYRAMID13", 13}};
  for (const auto& [type, nodes] : types) {
    mesh_of(cells_of(type, nodes)).write(path("mesh.e"));
    const auto input = value_of(read_input({path("mesh.e")}));
    EXPECT_EQ(input.points, static_cast<std::size_t>(2 * nodes)) << type;
  }
}

// VTK's reader reads past the end of their connectivity.
TEST_F(ExodusTest, CellsOfTooFewNodesAreRefused) {
  for (const auto& [type, nodes] :
       {std::pair{"TETRA", 3}, {"hex8", 4}, {"WEDGE", 5}, {"PYRAMID", 4}, {"TRI3", 2}, {"QUAD4", 3}, {"BAR2", 1}}) {
    mesh_of(cells_of(type, nodes)).write(path("mesh.e"));
    EXPECT_THAT(error_of({path("mesh.e")}), HasSubstr("block 10 is damaged: cells of type")) << type;
  }
}

TEST_F(ExodusTest, BlocksThatAreLeftOutAreCounted) {
  for (const auto& shell : {Block{"SHELL4", {{1, 2, 5, 4}, {2, 3, 6, 5}}}, Block{"TRI3", {{1, 2, 4}, {2, 3, 5}}},
                            Block{"SHELL9", {{1, 2, 3, 4, 5, 6, 7, 8, 9}, {10, 11, 12, 13, 14, 15, 16, 17, 18}}}})
    for (const bool first : {true, false}) {
      Mesh mesh = cube(2, 1, dvec3(0));
      mesh.blocks.insert(first ? mesh.blocks.begin() : mesh.blocks.end(), shell);
      mesh.write(path("mesh.e"));
      const auto input = value_of(read_input({path("mesh.e")}));
      EXPECT_NEAR(input.volume, 1, 1e-12);
      EXPECT_THAT(lines_of("mesh.e"), Contains("2 cells of blocks that are surfaces (left out)")) << shell.type;
      EXPECT_EQ(strict_error_of("mesh.e"), "(no error)");
    }
  // Lines and points of no volume are pieces: their points stay.
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.blocks.push_back({"BAR2", {{1, 2}, {2, 3}}});
  mesh.blocks.push_back({"SPHERE", {{5}}});
  mesh.write(path("mesh.e"));
  EXPECT_THAT(lines_of("mesh.e"), AllOf(Contains("2 cells: line"), Contains("1 cells: vertex")));
}

// A stream does not know its number of records beforehand.
TEST_F(ExodusTest, OpenNumbersOfRecordsAreCounted) {
  for (const int mode : {EX_CLOBBER | EX_64BIT_OFFSET, EX_CLOBBER | EX_64BIT_DATA}) {
    Mesh mesh = cube(3, 1, dvec3(0));
    mesh.mode = mode;
    mesh.write(path("mesh.e"));
    std::string whole = read_text_file(path("mesh.e")).value();
    ASSERT_EQ(whole.substr(0, 3), "CDF");
    const std::size_t bytes = whole[3] == 5 ? 8 : 4;  // of the number of records
    write("mesh.e", whole.replace(4, bytes, std::string(bytes, '\xff')));
    for (std::size_t step = 0; step < 2; ++step) {
      const auto input = value_of(read_input({path("mesh.e")}, {{"f"}, {}, times[step]}));
      ASSERT_TRUE(input.step.has_value());
      EXPECT_THAT(input.step->times, ElementsAre(0.5, 2));
      EXPECT_EQ(input.step->index, step);
      for (std::size_t i = 0; i < input.points; ++i)
        EXPECT_EQ(input.pieces[0].values[0][i], field(input.pieces[0].points[i], times[step]));
    }
    EXPECT_EQ(read_input({path("mesh.e")})->step->index, 1u) << "the last";

    // The last record is not whole.
    write("mesh.e", whole.substr(0, whole.size() - 100));
    const auto cut = value_of(read_input({path("mesh.e")}));
    EXPECT_THAT(cut.step->times, ElementsAre(0.5));

    // Without a whole record there are no values, and no zeros instead.
    for (std::size_t kept = whole.size() - 100; kept > whole.size() / 2; kept -= 100) {
      write("mesh.e", whole.substr(0, kept));
      const auto input = read_input({path("mesh.e")});
      for (std::size_t i = 0; input && i < input->points; ++i) {
        const double value = input->pieces[0].values[0][i];
        EXPECT_TRUE(std::isnan(value) || value == field(input->pieces[0].points[i], 0.5)) << kept;
      }
    }
  }
}

TEST_F(ExodusTest, OpenNumbersOfRecordsWithVariablesOfCellsAreRefused) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.of_cells = {{"p", cell_number}};
  mesh.write(path("mesh.e"));
  std::string whole = read_text_file(path("mesh.e")).value();
  write("mesh.e", whole.replace(4, 4, "\xff\xff\xff\xff"));
  EXPECT_THAT(error_of({path("mesh.e")}), HasSubstr("VTK's reader skips variables of cells: write 2 into"));
}

TEST_F(ExodusTest, MeshesInPiecesNeedAll) {
  const auto write_pieces = [&](int count, int digits) {
    std::vector<std::string> paths;
    for (int i = 0; i < count; ++i) {
      paths.push_back(path(fmt::format("mesh.e.{}.{:0{}}", count, i, digits)));
      cube(2, 1, dvec3(i, 0, 0)).write(paths.back());
    }
    return paths;
  };
  std::vector<std::string> four = write_pieces(4, 1);
  const auto all = value_of(read_input(four));
  EXPECT_NEAR(all.volume, 4, 1e-9);
  EXPECT_EQ(error_of({folder_}), "(no error)");
  std::filesystem::remove(path("mesh.e.4.2"));
  four.erase(four.begin() + 2);
  for (const std::vector<std::string>& inputs : std::vector<std::vector<std::string>>{four, {folder_}})
    EXPECT_THAT(error_of(inputs),
                AllOf(StartsWith(path("mesh.e.4.0") + ": the mesh has 4 pieces"), HasSubstr("mesh.e.4.2 is missing")));
  EXPECT_THAT(error_of({four[0]}), HasSubstr("mesh.e.4.3 are missing"));
  for (const std::string& file : four) std::filesystem::remove(file);

  std::vector<std::string> twelve = write_pieces(12, 2);
  EXPECT_EQ(error_of(twelve), "(no error)");
  twelve.erase(twelve.begin() + 3, twelve.begin() + 10);
  EXPECT_THAT(error_of(twelve), HasSubstr("mesh.e.12.06 and 3 more are missing: give all of them"));
}

TEST_F(ExodusTest, WithoutValuesGivesTheNumbersOfItsBlocks) {
  Mesh mesh = cube(2, 1, dvec3(0));
  mesh.nodal.clear();
  Block rest{"HEX8", {mesh.blocks[0].cells.end() - 3, mesh.blocks[0].cells.end()}};
  mesh.blocks[0].cells.resize(5);
  mesh.blocks.push_back(rest);
  mesh.write(path("mesh.e"));
  const auto input = value_of(read_input({path("mesh.e")}));
  EXPECT_THAT(input.attributes, ElementsAre("block"));
  ASSERT_EQ(input.pieces.size(), 2u);
  EXPECT_THAT(input.pieces[0].values.at(0), ElementsAre(1, 1, 1, 1, 1));
  EXPECT_THAT(input.pieces[1].values.at(0), ElementsAre(2, 2, 2));

  // Where only one of them has a volume, its number tells nothing.
  mesh.blocks[1] = {"SHELL4", {{1, 2, 5, 4}}};
  mesh.write(path("mesh.e"));
  EXPECT_THAT(value_of(read_input({path("mesh.e")})).attributes, ElementsAre("cell_volume"));
}

}  // namespace
}  // namespace splatvol::test
