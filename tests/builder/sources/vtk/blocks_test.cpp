// Files with blocks and time steps. The tests write them: with the formats' own libraries, or as text.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <vtk_cgns.h>
#include <vtk_hdf5.h>

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <span>
#include <sstream>
#include <tuple>
#include <utility>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "tests/builder/sources/exodus/exodus_mesh.h"
#include "tests/builder/sources/patches_of.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include VTK_CGNS(cgnslib.h)

// VTK's readers leak a little if they give up on a damaged file. The leak checker asks here which leaks to ignore.
extern "C" const char* __lsan_default_suppressions() { return "leak:libvtk\nleak:libnetcdf\nleak:libhdf5"; }

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr std::uint32_t cells = 3;  // along each edge of a block
constexpr std::uint32_t side = cells + 1;
constexpr std::size_t block_points = side * side * side;
constexpr std::size_t block_cells = cells * cells * cells;

/// A cube of `cells`^3 hexahedra with its lowest corner at (x, 0, 0).
struct Block {
  std::vector<dvec3> points;
  std::vector<std::array<std::uint32_t, 8>> hexahedra;
};

/// The corners of a hexahedron's faces: -x, +x, -y, +y, -z, +z.
constexpr std::array<std::array<std::size_t, 4>, 6> sides = {
    {{0, 4, 7, 3}, {1, 2, 6, 5}, {0, 1, 5, 4}, {3, 7, 6, 2}, {0, 3, 2, 1}, {4, 5, 6, 7}}};

Block cube(double x) {
  Block block;
  for (std::uint32_t k = 0; k < side; ++k)
    for (std::uint32_t j = 0; j < side; ++j)
      for (std::uint32_t i = 0; i < side; ++i)
        block.points.push_back(dvec3(x, 0, 0) + dvec3(i, j, k) / static_cast<double>(cells));
  for (std::uint32_t k = 0; k < cells; ++k)
    for (std::uint32_t j = 0; j < cells; ++j)
      for (std::uint32_t i = 0; i < cells; ++i) {
        const std::uint32_t a = i + side * (j + side * k), up = side * side;
        block.hexahedra.push_back(
            {a, a + 1, a + 1 + side, a + side, a + up, a + up + 1, a + up + 1 + side, a + up + side});
      }
  return block;
}

dvec3 center(const Block& block, std::size_t cell) {
  dvec3 sum(0);
  for (const std::uint32_t point : block.hexahedra[cell]) sum += block.points[point];
  return sum / 8.0;
}

const std::array<Block, 2> cubes = {cube(0), cube(1)};  // with the vector "U", (f, 2 f, -f)

/// The mean of the cells round a point, which have a linear field at their centres. It is exact between eight cells. At
/// the boundary of the cube that begins at `lowest_x` it is the field half a cell inwards.
double averaged(dvec3 p, double lowest_x, double time) {
  const double half = 0.5 / cells;
  return field(glm::clamp(p, dvec3(lowest_x, 0, 0) + half, dvec3(lowest_x + 1, 1, 1) - half), time);
}

struct BlocksTest : FolderTest {
  [[nodiscard]] std::string error_of(const std::string& name, const SourceOptions& options = {}) const {
    return test::error_of({path(name)}, options);
  }

  /// Reads a file of two blocks before and behind a tetrahedron with the arrays f and t of points. Calls check(input,
  /// number of the first block's piece, number of the tetrahedron's).
  template <class Check>
  void read_beside_other(const std::string& name, const Check& check) const {
    write("other.vtu", tetrahedron_at(5, {{"f", {1, 2, 3, 4}}, {"t", {5, 6, 7, 8}}}).file());
    for (const bool is_first : {true, false}) {
      std::vector<std::string> paths = {path(name), path("other.vtu")};
      if (!is_first) std::ranges::reverse(paths);
      const auto input = value_of(read_input(paths));
      EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "U", "U[0]", "U[1]", "U[2]", "q", "t"));
      check(input, is_first ? 0 : 1, is_first ? 2 : 0);
    }
  }

  /// Expects two cubes side by side, with the linear field at two time steps, 0.5 and 2. All formats here can hold
  /// these.
  void expect_two_blocks(const std::string& name, double tolerance) const {
    std::set<std::pair<std::uint64_t, std::uint64_t>> blocks;
    for (const auto& [asked, step] : {std::pair<std::optional<double>, std::size_t>{std::nullopt, 1}, {0.6, 0}}) {
      const auto input = value_of(read_input({path(name)}, {{}, {}, asked}));
      ASSERT_TRUE(input.step.has_value());
      EXPECT_EQ(input.step->index, step);
      EXPECT_EQ(input.step->times.size(), 2u);
      const double time = times[step];
      EXPECT_NEAR(input.step->time, time, 1e-6);
      blocks.insert({input.pieces.at(0).block, input.pieces.at(1).block});
      EXPECT_EQ(input.points, 2 * block_points);
      EXPECT_EQ(input.pieces.size(), 2u);
      EXPECT_NEAR(input.volume, 2, tolerance);
      EXPECT_EQ(input.census.cells.at("hexahedron"), 2 * block_cells);
      EXPECT_EQ(input.census.inverted, 0u);
      EXPECT_LT(largest_error(input, "f", [&](dvec3 p) { return field(p, time); }), tolerance);
      EXPECT_LT(largest_error(input, "U[1]", [&](dvec3 p) { return 2 * field(p, time); }), tolerance);
      const auto selected = value_of(read_input({path(name)}, {{"U[2]", "f"}, {}, asked}));
      EXPECT_THAT(selected.attributes, ElementsAre("U[2]", "f"));
      EXPECT_LT(largest_error(selected, "U[2]", [&](dvec3 p) { return -field(p, time); }), tolerance);
    }
    EXPECT_THAT(error_of(name, {{"nothing"}, {}, {}}), HasSubstr("no attribute \"nothing\"; there are: "));
    ASSERT_EQ(blocks.size(), 1u) << "they have the same numbers at each step";
    EXPECT_NE(blocks.begin()->first, blocks.begin()->second);
    EXPECT_NE(blocks.begin()->first * blocks.begin()->second, 0u);
    expect_joined(name);
    expect_apart_with_cells(name);
    expect_series(path(name), folder_, 2, {"f", "U[1]"});  // of points
  }

  /// Expects the first cube at both time steps, with means of the field over cells, in so many pieces.
  void expect_cube(const std::string& name, std::size_t pieces) const {
    for (std::size_t step = 0; step < 2; ++step) {
      const auto input = value_of(read_input({path(name)}, {{}, {}, times[step]}));
      ASSERT_TRUE(input.step.has_value());
      EXPECT_EQ(input.step->index, step);
      EXPECT_EQ(input.step->times.size(), 2u);
      EXPECT_EQ(input.pieces.size(), pieces);
      EXPECT_EQ(input.census.cells.at("hexahedron"), block_cells);
      EXPECT_EQ(input.census.without_volume, 0u);
      EXPECT_NEAR(input.volume, 1, 1e-6);
      EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "U", "U[0]", "U[1]", "U[2]"));
      EXPECT_LT(largest_error(input, "f", [&](dvec3 p) { return averaged(p, 0, times[step]); }), 1e-5);
      EXPECT_LT(largest_error(input, "U[1]", [&](dvec3 p) { return 2 * averaged(p, 0, times[step]); }), 1e-5);
    }
  }

  /// Expects that the points of the blocks' common face are merged.
  void expect_joined(const std::string& name) const {
    auto source = value_of(open_source({path(name)}, {{"f"}, {}, {}}));
    const auto report = value_of(build_volume(*source, path("out.svol"), {}, [](const char*, double) {}));
    EXPECT_EQ(report.points.merged, side * side);
    EXPECT_EQ(report.resolution_counts.back(), 2 * block_points - side * side);
  }

  /// Expects that these points stay apart in a series that keeps cells.
  void expect_apart_with_cells(const std::string& name) const { EXPECT_EQ(points_with_cells(name), 2 * block_points); }

  /// The points of a series of all steps that keeps cells.
  [[nodiscard]] std::uint64_t points_with_cells(const std::string& name) const {
    const auto silent = [](const char*, double) {};
    auto steps =
        value_of(steps_of_input({path(name)}, {{"f"}, {}, {}}, parse_times("all").value(), {open_source, list_arrays}));
    auto first = std::vector<SeriesStep>(steps.begin(), steps.begin() + 1), later = std::vector<SeriesStep>(steps);
    later.erase(later.begin());
    EXPECT_EQ(message_of(build_series(first, path("kept.svol"), {.keep_cells = true}, silent)), "");
    EXPECT_EQ(message_of(append_to_series(later, path("kept.svol"), {}, silent)), "");
    const auto volume = value_of(format::Volume::open(open_file(path("kept.svol")).value()));
    EXPECT_EQ(message_of(volume->verify([](double) {})), "");
    EXPECT_TRUE(volume->info().cells->blocks_apart);
    return volume->info().point_count();
  }

  /// The error of a build that may change nothing, or "(no error)".
  [[nodiscard]] std::string strict_error_of(const std::string& name) const {
    auto source = open_source({path(name)}, {});
    if (!source) return source.error().message;
    const auto report = build_volume(**source, path("out.svol"), {.strict = true}, [](const char*, double) {});
    return report ? "(no error)" : report.error().message;
  }

  /// The triangles of each patch of the boundary.
  [[nodiscard]] std::map<std::string, std::size_t> patches_of(const std::string& name,
                                                              SourceOptions options = {}) const {
    return test::patches_of({path(name)}, folder_, std::move(options));
  }

  static constexpr std::size_t all_cuts = ~std::size_t{0};  // as `fewest_errors`

  /// Cuts a file after every `stride` bytes. Expects no crash, no hang and no output, but an error of one line or a
  /// smaller mesh.
  void expect_survives_truncation(const std::string& name, const std::string& opened, std::size_t stride,
                                  std::size_t fewest_errors = 1) const {
    const std::string whole = read_text_file(path(name)).value();
    std::size_t errors = 0;
    for (std::size_t bytes = 0; bytes < whole.size(); bytes += stride) {
      write(name, whole.substr(0, bytes));
      errors += error_of(opened) != "(no error)" ? 1 : 0;
    }
    EXPECT_GE(errors, fewest_errors == all_cuts ? (whole.size() + stride - 1) / stride : fewest_errors);
    write(name, whole);
    EXPECT_EQ(error_of(opened), "(no error)");
  }
};

// Exodus: both blocks share one numbering of the points. Only the second has an element variable.

ExodusMesh exodus_mesh() {
  ExodusMesh mesh;
  const auto number_of = [&](dvec3 p) {
    const auto found = std::ranges::find_if(
        mesh.points, [&](dvec3 q) { return glm::all(glm::lessThan(glm::abs(p - q), dvec3(1e-9))); });
    const auto number = static_cast<int>(found - mesh.points.begin()) + 1;
    if (found == mesh.points.end()) mesh.points.push_back(p);
    return number;
  };
  for (const Block& block : cubes) {
    mesh.blocks.push_back({"HEX8", {}});
    for (const auto& hexahedron : block.hexahedra) {
      auto& cell = mesh.blocks.back().cells.emplace_back();
      for (const std::uint32_t point : hexahedron) cell.push_back(number_of(block.points[point]));
    }
  }
  for (const auto& [name, factor] : {std::pair{"Ux", 1.0}, {"Uy", 2.0}, {"Uz", -1.0}})
    mesh.nodal.emplace_back(name, [factor = factor](dvec3 p, double time) { return factor * field(p, time); });
  mesh.of_cells = {{"q", [](std::size_t cell, double time) { return field(center(cubes[1], cell), time); }}};
  return mesh;
}

TEST_F(BlocksTest, Exodus) {
  exodus_mesh().write(path("mesh.e"));
  expect_two_blocks("mesh.e", 1e-5);  // the reader's coordinates are of single precision
  const auto input = value_of(read_input({path("mesh.e")}, {{"q", "f"}, {}, {}}));
  for (const double value : input.pieces[0].values[0]) EXPECT_TRUE(std::isnan(value)) << "not in this block";
  for (std::size_t i = 0; i < block_points; ++i)
    EXPECT_NEAR(input.pieces[1].values[0][i], averaged(input.pieces[1].points[i], 1, 2), 1e-5);
}

std::vector<double> values_in(const Input& input, std::size_t piece, const std::string& attribute) {
  return input.pieces.at(piece).values.at(input.index_of(attribute));
}

MATCHER(AreMissing, "") {
  return std::ranges::all_of(arg, [](double value) { return std::isnan(value); });
}

MATCHER(AreThere, "") {
  return std::ranges::none_of(arg, [](double value) { return std::isnan(value); });
}

TEST_F(BlocksTest, ExodusBesideOtherFiles) {
  exodus_mesh().write(path("mesh.e"));
  read_beside_other("mesh.e", [](const Input& input, std::size_t block, std::size_t other) {
    EXPECT_THAT(values_in(input, block, "t"), AreMissing());
    EXPECT_THAT(values_in(input, block, "q"), AreMissing());
    EXPECT_THAT(values_in(input, block + 1, "q"), AreThere());
    EXPECT_THAT(values_in(input, block + 1, "U[1]"), AreThere());
    EXPECT_THAT(values_in(input, other, "q"), AreMissing());
    EXPECT_THAT(values_in(input, other, "U[1]"), AreMissing());
    EXPECT_THAT(values_in(input, other, "t"), ElementsAre(5, 6, 7, 8));
    EXPECT_THAT(values_in(input, other, "f"), ElementsAre(1, 2, 3, 4));
  });
}

// The upper sides of the first block, and a side of one cell of the second.
TEST_F(BlocksTest, ExodusSideSetsArePatches) {
  ExodusMesh mesh = exodus_mesh();
  mesh.side_sets = {{"lid", {}}, {"", {{block_cells + 1, 5}}}};
  for (int cell = block_cells - 8; cell <= static_cast<int>(block_cells); ++cell)
    mesh.side_sets[0].sides.emplace_back(cell, 6);
  mesh.write(path("mesh.e"));
  expect_two_blocks("mesh.e", 1e-5);
  EXPECT_THAT(patches_of("mesh.e"),
              UnorderedElementsAre(Pair("lid", 18), Pair("Unnamed set ID: 8", 2), Pair("outer", 160)));
}

// NetCDF's own format is known by its first bytes. Names of the parts of a mesh end in numbers.
TEST_F(BlocksTest, ExodusByContentAndByPartNumber) {
  for (const char* name : {"anything.dat", "mesh.exo", "mesh.g", "mesh.e.1.0"}) {
    exodus_mesh().write(path(name));
    const auto input = value_of(read_input({path(name)}));
    EXPECT_EQ(input.points, 2 * block_points);
  }
}

// VTK's reader goes past the end of a list if two blocks have the same id: both are 0 if the disk was full before the
// ids.
TEST_F(BlocksTest, ExodusBlocksOfOneIdAreRefused) {
  exodus_mesh().write(path("mesh.e"));
  const std::string whole = read_text_file(path("mesh.e")).value();
  std::size_t refused = 0;
  for (std::size_t bytes = 1000; bytes < 2500; bytes += 25) {
    write("mesh.e", whole.substr(0, bytes) + std::string(whole.size() - bytes, '\0'));
    refused += error_of("mesh.e").find("have the same id") != std::string::npos ? 1 : 0;
  }
  EXPECT_GE(refused, 1u);
}

TEST_F(BlocksTest, ExodusOfShellsOnlyIsNoVolume) {
  ExodusMesh plate{.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, .blocks = {{"SHELL4", {{1, 2, 3, 4}}}}};
  plate.nodal.clear();
  plate.write(path("shells.e"));
  EXPECT_THAT(error_of("shells.e"), HasSubstr("only surface cells (1 quadrilateral); splatvol draws volumes"));
}

TEST_F(BlocksTest, ExodusOfBarsOnlyIsNoVolume) {
  ExodusMesh frame{.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, .blocks = {{"BAR2", {{1, 2}}}, {"BAR2", {{2, 3}}}}};
  frame.nodal.clear();
  frame.write(path("bars.e"));
  EXPECT_THAT(error_of("bars.e"), HasSubstr("no cells with a volume, and no values; splatvol draws volumes"));
}

TEST_F(BlocksTest, ExodusNumbersOfPointsThatAreNotThere) {
  exodus_mesh().write(path("mesh.e"));
  const std::string whole = read_text_file(path("mesh.e")).value();
  std::string corners;  // of the first hexahedron, big-endian
  for (int i = 0; i < 8; ++i)
    corners += std::string(3, '\0') + static_cast<char>(exodus_mesh().blocks[0].cells[0].at(i));
  const std::size_t at = whole.find(corners);
  ASSERT_NE(at, std::string::npos);
  for (const char* number : {"\x7f\x7f\x7f\x7f", "\x80\x80\x80\x80", "\xff\xff\xff\xff"}) {
    std::string damaged = whole;
    write("mesh.e", damaged.replace(at, 4, number));
    EXPECT_THAT(error_of("mesh.e"), StartsWith(path("mesh.e") + ": "));
  }
}

// A header of some hundred bytes, for a mesh of two billion points.
TEST_F(BlocksTest, ExodusOfAHeaderOnlyTakesNoMemory) {
  const auto number = [](std::uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 0xff);
    return bytes;
  };
  const std::vector<std::pair<std::string, std::uint32_t>> dimensions = {
      {"num_dim", 3},    {"num_nodes", 0x7fffffff},      {"num_elem", 0x7fffffff},
      {"num_el_blk", 1}, {"num_el_in_blk1", 0x7fffffff}, {"num_nod_per_el1", 8}};
  std::string header =
      std::string("CDF\1", 4) + number(0) + number(10) + number(static_cast<std::uint32_t>(dimensions.size()));
  for (const auto& [name, length] : dimensions) {
    header += number(static_cast<std::uint32_t>(name.size())) + name;
    header.resize((header.size() + 3) / 4 * 4, '\0');
    header += number(length);
  }
  write("mesh.e", header + number(0) + number(0) + number(0) + number(0));
  EXPECT_THAT(error_of("mesh.e"), StartsWith(path("mesh.e") + ": "));
}

TEST_F(BlocksTest, ExodusTruncated) {
  exodus_mesh().write(path("mesh.e"));
  expect_survives_truncation("mesh.e", "mesh.e", 89, all_cuts);
}

// EnSight Gold: each part has points of its own.

std::string ensight_numbers(const std::function<double(std::size_t)>& value, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += fmt::format("{:12.5e}\n", value(i));
  return text;
}

void write_ensight(const TempFolder& folder) {
  folder.write("mesh.case",
               "FORMAT\ntype: ensight gold\n\nGEOMETRY\nmodel: mesh.geo\n\nVARIABLE\nscalar per node: 1 f f.***\n"
               "vector per node: 1 U U.***\nscalar per element: 1 q q.***\n\nTIME\ntime set: 1\nnumber of steps: 2\n"
               "filename start number: 0\nfilename increment: 1\ntime values: 0.5 2.0\n");
  std::string geometry = "two cubes\nand a wall\nnode id assign\nelement id assign\n";
  for (std::size_t b = 0; b < 2; ++b) {
    geometry += fmt::format("part\n{:10}\ncube\ncoordinates\n{:10}\n", b + 1, block_points);
    for (int axis = 0; axis < 3; ++axis)
      geometry += ensight_numbers([&](std::size_t i) { return cubes[b].points[i][axis]; }, block_points);
    geometry += fmt::format("hexa8\n{:10}\n", block_cells);
    for (const auto& hexahedron : cubes[b].hexahedra) {
      for (const std::uint32_t point : hexahedron) geometry += fmt::format("{:10}", point + 1);
      geometry += '\n';
    }
  }
  geometry += fmt::format("part\n{:10}\nwall\ncoordinates\n{:10}\n", 3, 4);
  for (const char* axis : {"0 1 1 0", "0 0 1 1", "0 0 0 0"})
    for (const char c : std::string_view(axis))
      if (c != ' ') geometry += fmt::format("{:12.5e}\n", c - '0' + 0.0);
  geometry += fmt::format("quad4\n{:10}\n{:10}{:10}{:10}{:10}\n", 1, 1, 2, 3, 4);
  folder.write("mesh.geo", geometry);
  for (std::size_t step = 0; step < 2; ++step) {
    std::string f = "f\n", u = "U\n", q = "q\n";
    for (std::size_t b = 0; b < 2; ++b) {
      const auto value = [&](std::size_t i) { return field(cubes[b].points[i], times[step]); };
      f += fmt::format("part\n{:10}\ncoordinates\n", b + 1) + ensight_numbers(value, block_points);
      u += fmt::format("part\n{:10}\ncoordinates\n", b + 1);
      for (const double factor : {1, 2, -1})
        u += ensight_numbers([&](std::size_t i) { return factor * value(i); }, block_points);
      q += fmt::format("part\n{:10}\nhexa8\n", b + 1) +
           ensight_numbers([&](std::size_t i) { return field(center(cubes[b], i), times[step]); }, block_cells);
    }
    folder.write(fmt::format("f.{:03}", step), f);
    folder.write(fmt::format("U.{:03}", step), u);
    folder.write(fmt::format("q.{:03}", step), q);
  }
}

TEST_F(BlocksTest, EnSight) {
  write_ensight(*this);
  expect_two_blocks("mesh.case", 3e-5);
  const auto input = value_of(read_input({path("mesh.case")}, {{"q"}, {}, {}}));
  for (std::size_t b = 0; b < 2; ++b)
    for (std::size_t i = 0; i < block_points; ++i)
      EXPECT_NEAR(input.pieces[b].values[0][i], averaged(cubes[b].points[i], static_cast<double>(b), 2), 3e-5);
}

TEST_F(BlocksTest, EnSightVariablesOfOnePart) {
  write_ensight(*this);
  for (std::size_t step = 0; step < 2; ++step)
    for (const char* name : {"f", "q"}) {
      const std::string file = fmt::format("{}.{:03}", name, step), whole = read_text_file(path(file)).value();
      const std::size_t second = whole.find("part", whole.find("part") + 1);
      write(file, whole.substr(0, whole.find("part")) + whole.substr(second));
    }
  read_beside_other("mesh.case", [](const Input& input, std::size_t part, std::size_t other) {
    EXPECT_THAT(values_in(input, part, "f"), AreMissing());
    EXPECT_THAT(values_in(input, part, "q"), AreMissing());
    EXPECT_THAT(values_in(input, part, "U"), AreThere());
    EXPECT_THAT(values_in(input, part + 1, "f"), AreThere());
    EXPECT_THAT(values_in(input, part + 1, "q"), AreThere());
    EXPECT_THAT(values_in(input, part + 1, "t"), AreMissing());
    EXPECT_THAT(values_in(input, other, "q"), AreMissing());
    EXPECT_THAT(values_in(input, other, "t"), AreThere());
  });
}

TEST_F(BlocksTest, EnSightSurfacesArePatches) {
  write_ensight(*this);
  for (const bool patches : {false, true}) {
    const auto input = value_of(read_input({path("mesh.case")}, {.patches = patches}));
    EXPECT_EQ(input.census.left_out, patches ? 0u : 1u) << "the wall";
  }
  EXPECT_THAT(patches_of("mesh.case"), UnorderedElementsAre(Pair("wall", 2), Pair("outer", 180)));
}

TEST_F(BlocksTest, EnSightCasesThatCannotBeRead) {
  write_ensight(*this);
  write("a.case", replaced(read("mesh.case"), "mesh.geo", "\"mesh.geo\""));
  EXPECT_THAT(error_of("a.case"), HasSubstr("takes no names in quotation marks; remove them: sed"));

  // Only the wall, which is a surface.
  std::string geometry = read_text_file(path("mesh.geo")).value();
  geometry.erase(geometry.find("part\n"), geometry.rfind("part\n") - geometry.find("part\n"));
  write("wall.geo", geometry);
  write("wall.case", "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: wall.geo\n");
  EXPECT_THAT(error_of("wall.case"), AllOf(HasSubstr("only surface cells ("), HasSubstr("; splatvol draws volumes")));
}

// All steps in one file: the section FILE has numbers of steps, too.
TEST_F(BlocksTest, EnSightSingleFiles) {
  write_ensight(*this);
  const auto joined = [&](const std::string& a, const std::string& b) {
    const auto step = [&](const std::string& name) {
      return "BEGIN TIME STEP\n" + read_text_file(path(name)).value() + "END TIME STEP\n";
    };
    return step(a) + step(b);
  };
  write("all.geo", joined("mesh.geo", "mesh.geo"));
  write("all.f", joined("f.000", "f.001"));
  write("all.case",
        "FORMAT\ntype: ensight gold\n\nGEOMETRY\nmodel: 1 1 all.geo\n\nVARIABLE\nscalar per node: 1 1 f all.f\n\nTIME\n"
        "time set: 1\nnumber of steps: 2\ntime values: 0.5 2.0\n\nFILE\nfile set: 1\nnumber of steps: 2\n");
  for (std::size_t step = 0; step < 2; ++step) {
    const auto input = value_of(read_input({path("all.case")}, {{}, {}, times[step]}));
    EXPECT_EQ(input.step->index, step);
    EXPECT_LT(largest_error(input, "f", [&](dvec3 p) { return field(p, times[step]); }), 3e-5);
  }
  expect_series(path("all.case"), folder_, 2);
}

TEST_F(BlocksTest, EnSightTruncated) {
  write_ensight(*this);
  expect_survives_truncation("mesh.case", "mesh.case", 1);
  expect_survives_truncation("mesh.geo", "mesh.case", 97);
  // VTK's reader does not notice that values are missing.
  expect_survives_truncation("f.001", "mesh.case", 101, 0);
  expect_survives_truncation("q.001", "mesh.case", 101, 0);
}

// CGNS: a zone of hexahedra and a structured zone.

constexpr bool is_structured(std::size_t block) { return block == 1; }

/// Surfaces of the first zone have the numbers before those of its cells.
constexpr cgsize_t wall_cells = cells * cells;

void write_coordinates(int file, int base, int zone, const Block& block) {
  for (int axis = 0; axis < 3; ++axis) {
    int ignored = 0;
    std::vector<double> values;
    for (const dvec3& p : block.points) values.push_back(p[axis]);
    cg_coord_write(file, base, zone, CGNS_ENUMV(RealDouble),
                   fmt::format("Coordinate{}", "XYZ"[static_cast<std::size_t>(axis)]).c_str(), values.data(), &ignored);
  }
}

/// Writes the faces of the first zone in the plane x = 0, with numbers from `first` on.
void write_walls(int file, int base, const char* name, cgsize_t first) {
  int ignored = 0;
  std::vector<cgsize_t> walls;
  for (cgsize_t k = 0; k < cells; ++k)
    for (cgsize_t j = 0; j < cells; ++j) {
      const cgsize_t a = 1 + side * (j + side * k);
      walls.insert(walls.end(), {a, a + side * side, a + side * side + side, a + side});
    }
  cg_section_write(file, base, 1, name, CGNS_ENUMV(QUAD_4), first, first + wall_cells - 1, 0, walls.data(), &ignored);
}

/// Writes a zone without its values, and returns its number.
int write_zone(int file, int base, std::size_t b, bool walls_first) {
  const std::array<cgsize_t, 3> unstructured_size = {block_points, block_cells, 0};
  const std::array<cgsize_t, 9> structured_size = {side, side, side, cells, cells, cells, 0, 0, 0};
  int zone = 0, ignored = 0;
  cg_zone_write(file, base, is_structured(b) ? "Second" : "First",
                is_structured(b) ? structured_size.data() : unstructured_size.data(),
                is_structured(b) ? CGNS_ENUMV(Structured) : CGNS_ENUMV(Unstructured), &zone);
  write_coordinates(file, base, zone, cubes[b]);
  if (is_structured(b)) return zone;
  std::vector<cgsize_t> connectivity;
  for (const auto& hexahedron : cubes[b].hexahedra)
    for (const std::uint32_t point : hexahedron) connectivity.push_back(point + 1);
  const cgsize_t before = walls_first ? wall_cells : 0;
  cg_section_write(file, base, zone, "Cells", CGNS_ENUMV(HEXA_8), before + 1, before + cgsize_t{block_cells}, 0,
                   connectivity.data(), &ignored);
  if (walls_first) write_walls(file, base, "Wall", 1);
  return zone;
}

/// Writes the values of a zone at both time steps.
void write_solutions(int file, int base, int zone, std::size_t b) {
  std::string pointers;
  for (std::size_t step = 0; step < 2; ++step) {
    int solution = 0;
    const std::string name = fmt::format("Solution{}", step);
    cg_sol_write(file, base, zone, name.c_str(), CGNS_ENUMV(Vertex), &solution);
    pointers += fmt::format("{:32}", name);
    const auto put = [&](const char* array, double factor) {
      int ignored = 0;
      std::vector<double> values;
      for (const dvec3& p : cubes[b].points) values.push_back(factor * field(p, times[step]));
      cg_field_write(file, base, zone, solution, CGNS_ENUMV(RealDouble), array, values.data(), &ignored);
    };
    put("f", 1), put("UX", 1), put("UY", 2), put("UZ", -1);
    if (is_structured(b)) put("only", 1);
  }
  cg_ziter_write(file, base, zone, "ZoneSteps");
  cg_goto(file, base, "Zone_t", zone, "ZoneIterativeData_t", 1, "end");
  const std::array<cgsize_t, 2> size = {32, 2};
  cg_array_write("FlowSolutionPointers", CGNS_ENUMV(Character), 2, size.data(), pointers.data());
}

void write_cgns(const std::string& path, bool walls_first = false) {
  int file = 0, base = 0;
  ASSERT_EQ(cg_open(path.c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
  cg_base_write(file, "Base", 3, 3, &base);
  cg_biter_write(file, base, "Steps", 2);
  cg_goto(file, base, "BaseIterativeData_t", 1, "end");
  const cgsize_t two = 2;
  cg_array_write("TimeValues", CGNS_ENUMV(RealDouble), 1, &two, times.data());
  for (std::size_t b = 0; b < 2; ++b) write_solutions(file, base, write_zone(file, base, b, walls_first), b);
  cg_simulation_type_write(file, base, CGNS_ENUMV(TimeAccurate));
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
}

TEST_F(BlocksTest, Cgns) {
  write_cgns(path("mesh.cgns"));
  expect_two_blocks("mesh.cgns", 1e-12);
  const auto input = value_of(read_input({path("mesh.cgns")}, {{"only"}, {}, {}}));
  for (const double value : input.pieces[0].values[0]) EXPECT_TRUE(std::isnan(value)) << "not in this zone";
  for (std::size_t i = 0; i < block_points; ++i)
    EXPECT_DOUBLE_EQ(input.pieces[1].values[0][i], field(cubes[1].points[i], 2));
}

TEST_F(BlocksTest, CgnsWithoutValuesGivesTheNumbersOfItsZones) {
  int file = 0, base = 0;
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
  cg_base_write(file, "Base", 3, 3, &base);
  for (std::size_t b = 0; b < 2; ++b) write_zone(file, base, b, false);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  const auto input = value_of(read_input({path("mesh.cgns")}));
  EXPECT_THAT(input.attributes, ElementsAre("block"));
  ASSERT_EQ(input.pieces.size(), 2u);
  for (std::size_t b = 0; b < 2; ++b) EXPECT_THAT(input.pieces[b].values.at(0), Each(static_cast<double>(b + 1)));
}

// VTK 9.1 takes the first elements for the cells.
TEST_F(BlocksTest, CgnsWithWallsBeforeCells) {
  write_cgns(path("mesh.cgns"), true);
  expect_two_blocks("mesh.cgns", 1e-12);
  EXPECT_THAT(patches_of("mesh.cgns"), UnorderedElementsAre(Pair("Wall", 18), Pair("outer", 162)));
  expect_survives_truncation("mesh.cgns", "mesh.cgns", 2003, all_cuts);
}

/// Writes over the numbers of a node in an HDF5 file.
void change_node(const std::string& path, const std::string& node, hid_t type, const void* numbers) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t data = H5Dopen2(file, (node + "/ data").c_str(), H5P_DEFAULT);
  EXPECT_GE(H5Dwrite(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers), 0);
  H5Dclose(data);
  H5Fclose(file);
}

// Types of elements behind pyramids have higher numbers there. VTK's reader takes hexahedra for quadratic ones.
TEST_F(BlocksTest, CgnsOfVersion3) {
  int file = 0, base = 0;
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
  cg_base_write(file, "Base", 3, 3, &base);
  write_zone(file, base, 0, false);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  const float version = 3.0F;
  const std::array<int, 2> hexahedra = {CGNS_ENUMV(HEXA_8) + 1, 0};
  change_node(path("mesh.cgns"), "/CGNSLibraryVersion", H5T_NATIVE_FLOAT, &version);
  change_node(path("mesh.cgns"), "/Base/First/Cells", H5T_NATIVE_INT, hexahedra.data());
  EXPECT_EQ(value_of(read_input({path("mesh.cgns")})).census.cells.at("hexahedron"), block_cells);
}

// VTK's reader names vectors so. It hides none behind a field of the same name.
TEST_F(BlocksTest, CgnsVectorsByTheirComponents) {
  for (const bool walls_first : {false, true}) {
    SCOPED_TRACE(walls_first);
    int file = 0, base = 0, solution = 0, ignored = 0;
    ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
    cg_base_write(file, "Base", 3, 3, &base);
    const int zone = write_zone(file, base, 0, walls_first);
    cg_sol_write(file, base, zone, "Solution", CGNS_ENUMV(Vertex), &solution);
    double value = 0;
    for (const char* name : {"a_x", "a_y", "a_z", "b", "b_x", "b_y", "b_z", "c", "cX", "cY", "cZ", "dX", "dY", "dZ"}) {
      const std::vector<double> values(block_points, ++value);
      cg_field_write(file, base, zone, solution, CGNS_ENUMV(RealDouble), name, values.data(), &ignored);
    }
    ASSERT_EQ(cg_close(file), 0) << cg_get_error();
    const auto input = value_of(read_input({path("mesh.cgns")}));
    EXPECT_THAT(input.attributes, ElementsAre("a", "a[0]", "a[1]", "a[2]", "b", "b_x", "b_y", "b_z", "c", "cX", "cY",
                                              "cZ", "d", "d[0]", "d[1]", "d[2]"));
    std::vector<double> first;
    for (const auto& values : input.pieces.at(0).values) first.push_back(values.front());
    EXPECT_THAT(first, ElementsAre(DoubleNear(std::sqrt(1 + 4 + 9), 1e-12), 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11,
                                   DoubleNear(std::sqrt(144 + 169 + 196), 1e-12), 12, 13, 14));
  }
}

/// Adds a solution with the field "values" of this name at a place.
void write_values(int file, int zone, const char* name, CGNS_ENUMT(GridLocation_t) location,
                  const std::vector<double>& values) {
  int solution = 0, ignored = 0;
  EXPECT_EQ(cg_sol_write(file, 1, zone, fmt::format("Of {}", name).c_str(), location, &solution), 0) << cg_get_error();
  EXPECT_EQ(cg_field_write(file, 1, zone, solution, CGNS_ENUMV(RealDouble), name, values.data(), &ignored), 0)
      << cg_get_error();
}

/// Turns the place of a solution into FaceCenter, which the library does not write.
void move_to_faces(const std::string& path, const char* location) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), text = H5Dopen2(file, location, H5P_DEFAULT);
  EXPECT_GE(H5Dwrite(text, H5T_NATIVE_SCHAR, H5S_ALL, H5S_ALL, H5P_DEFAULT, "FaceCenter"), 0);
  H5Dclose(text);
  H5Fclose(file);
}

// Values of cells behind walls, a flat zone with values, whose cells are left out, and values of faces.
TEST_F(BlocksTest, CgnsZonesThatDefeatVtk) {
  int file = 0, base = 0, flat = 0, ignored = 0;
  for (const bool walls_first : {false, true}) {
    SCOPED_TRACE(walls_first);
    ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
    cg_base_write(file, "Base", 3, 3, &base);
    write_zone(file, base, 0, walls_first);
    std::vector<double> of_cells;
    for (std::size_t cell = 0; cell < block_cells; ++cell) of_cells.push_back(field(center(cubes[0], cell), 0));
    write_values(file, 1, "c", CGNS_ENUMV(CellCenter), of_cells);
    write_values(file, 1, "flux", CGNS_ENUMV(CellCenter), of_cells);
    ASSERT_EQ(cg_close(file), 0) << cg_get_error();
    move_to_faces(path("mesh.cgns"), "/Base/First/Of flux/GridLocation/ data");
    const auto input = value_of(read_input({path("mesh.cgns")}));
    EXPECT_THAT(input.attributes, ElementsAre("c"));
    EXPECT_LT(largest_error(input, "c", [](dvec3 p) { return averaged(p, 0, 0); }), 1e-12);
    EXPECT_THAT(input.census.losses, ElementsAre("flux: left out, no solution of points or of cells"));

    ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
    const std::array<cgsize_t, 9> size = {3, 2, 1, 2, 1, 0, 0, 0, 0};
    cg_zone_write(file, 1, "Flat", size.data(), CGNS_ENUMV(Structured), &flat);
    const std::array<std::vector<double>, 3> axes = {{{5, 6, 7, 5, 6, 7}, {0, 0, 0, 1, 1, 1}, {0, 0, 0, 0, 0, 0}}};
    for (std::size_t axis = 0; axis < 3; ++axis)
      cg_coord_write(file, 1, flat, CGNS_ENUMV(RealDouble), fmt::format("Coordinate{}", "XYZ"[axis]).c_str(),
                     axes[axis].data(), &ignored);
    write_values(file, flat, "p", CGNS_ENUMV(Vertex), {1, 2, 3, 4, 5, 6});
    ASSERT_EQ(cg_close(file), 0) << cg_get_error();
    const auto beside = value_of(read_input({path("mesh.cgns")}, {{"c"}, {}, {}}));
    EXPECT_EQ(beside.pieces.size(), 1u);
    EXPECT_LT(largest_error(beside, "c", [](dvec3 p) { return averaged(p, 0, 0); }), 1e-12);
    auto source = value_of(open_source({path("mesh.cgns")}, {}));
    while (value_of(source->next())) {
    }
    EXPECT_EQ(source->left_out_cells(), 2u);
  }
}

// A cell that names a point which is not there, and sections of elements that cannot be read beside others.
TEST_F(BlocksTest, DamagedCgnsZones) {
  const auto error_with = [&](CGNS_ENUMT(ElementType_t) type, const std::vector<cgsize_t>& points) {
    write_cgns(path("mesh.cgns"), true);
    int file = 0, ignored = 0;
    EXPECT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
    const auto next = wall_cells + cgsize_t{block_cells} + 1;
    cg_section_write(file, 1, 1, "More", type, next, next, 0, points.data(), &ignored);
    EXPECT_EQ(cg_close(file), 0) << cg_get_error();
    return error_of("mesh.cgns");
  };
  EXPECT_THAT(error_with(CGNS_ENUMV(TETRA_4), {1, 2, 3, 999}), HasSubstr("an element names point 999 of 64"));
  EXPECT_THAT(error_with(CGNS_ENUMV(TETRA_4), {0, 2, 3, 4}), HasSubstr("an element names point 0 of 64"));
  EXPECT_THAT(error_with(CGNS_ENUMV(PYRA_14), std::vector<cgsize_t>(14, 1)), HasSubstr("CGNS's type PYRA_14"));
}

/// Copies the objects of an HDF5 group into a group that keeps no order of creation.
void copy_unordered(hid_t from, hid_t to) {
  H5Literate(
      from, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr,
      [](hid_t source, const char* name, const H5L_info_t*, void* data) -> herr_t {
        const hid_t target = *static_cast<hid_t*>(data);
        const hid_t object = H5Oopen(source, name, H5P_DEFAULT);
        if (H5Iget_type(object) == H5I_GROUP) {
          const hid_t group = H5Gcreate2(target, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
          copy_unordered(object, group);
          H5Gclose(group);
        } else {
          H5Ocopy(source, name, target, name, H5P_DEFAULT, H5P_DEFAULT);
        }
        H5Oclose(object);
        return 0;
      },
      &to);
  H5Aiterate2(
      from, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr,
      [](hid_t source, const char* name, const H5A_info_t*, void* data) -> herr_t {
        const hid_t attribute = H5Aopen(source, name, H5P_DEFAULT), type = H5Aget_type(attribute),
                    space = H5Aget_space(attribute);
        std::array<char, 256> bytes{};
        EXPECT_LE(H5Aget_storage_size(attribute), bytes.size());
        H5Aread(attribute, type, bytes.data());
        const hid_t copy = H5Acreate2(*static_cast<hid_t*>(data), name, type, space, H5P_DEFAULT, H5P_DEFAULT);
        H5Awrite(copy, type, bytes.data());
        for (const hid_t id : {copy, attribute}) H5Aclose(id);
        H5Sclose(space);
        H5Tclose(type);
        return 0;
      },
      &to);
}

// As by CGNS before 3.2, and by other writers of HDF5. VTK 9.1 finds nothing in such files.
TEST_F(BlocksTest, CgnsWithoutOrderOfCreation) {
  write_cgns(path("ordered.cgns"));
  const hid_t from = H5Fopen(path("ordered.cgns").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT),
              to = H5Fcreate(path("mesh.cgns").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t from_root = H5Gopen2(from, "/", H5P_DEFAULT), root = H5Gopen2(to, "/", H5P_DEFAULT);
  copy_unordered(from_root, root);
  for (const hid_t group : {from_root, root}) H5Gclose(group);
  for (const hid_t file : {from, to}) H5Fclose(file);
  expect_two_blocks("mesh.cgns", 1e-12);
}

// A section of quadrilaterals, whose cells stand behind those with a volume.
TEST_F(BlocksTest, CgnsSectionsAndConditionsArePatches) {
  write_cgns(path("mesh.cgns"));
  int file = 0, ignored = 0;
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
  write_walls(file, 1, "Inlet", block_cells + 1);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  expect_two_blocks("mesh.cgns", 1e-12);
  EXPECT_THAT(patches_of("mesh.cgns"), UnorderedElementsAre(Pair("Inlet", 18), Pair("outer", 162)));

  // A condition for some cells of the section, one with a family for points of the structured zone, and one for points
  // of the other zone, which tells no faces.
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
  const std::array<cgsize_t, 2> range = {block_cells + 2, block_cells + 4};
  cg_boco_write(file, 1, 1, "Slot", CGNS_ENUMV(BCWall), CGNS_ENUMV(PointRange), 2, range.data(), &ignored);
  cg_boco_gridlocation_write(file, 1, 1, ignored, CGNS_ENUMV(FaceCenter));
  const std::array<cgsize_t, 3> list = {1, 2, 3};
  cg_boco_write(file, 1, 1, "Points", CGNS_ENUMV(BCWall), CGNS_ENUMV(PointList), 3, list.data(), &ignored);
  const std::array<cgsize_t, 6> corners = {1, 1, side, side, side, side};
  cg_boco_write(file, 1, 2, "Lid", CGNS_ENUMV(BCWall), CGNS_ENUMV(PointRange), 2, corners.data(), &ignored);
  cg_goto(file, 1, "Zone_t", 2, "ZoneBC_t", 1, "BC_t", ignored, "end");
  cg_famname_write("Top");
  const std::array<cgsize_t, 6> edge = {1, 1, 1, 1, side, 1};
  cg_boco_write(file, 1, 2, "Edge", CGNS_ENUMV(BCWall), CGNS_ENUMV(PointRange), 2, edge.data(), &ignored);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  expect_two_blocks("mesh.cgns", 1e-12);
  EXPECT_THAT(patches_of("mesh.cgns"),
              UnorderedElementsAre(Pair("Inlet", 12), Pair("Slot", 6), Pair("Top", 18), Pair("outer", 144)));
}

/// Writes the first cube as polyhedra: its faces, polygons 1 to 108, then its cells, each with the numbers of its
/// faces. Returns the numbers of the faces in the plane x = 0.
std::vector<cgsize_t> write_polyhedra(const std::string& path) {
  const Block& block = cubes[0];
  std::map<std::set<std::uint32_t>, cgsize_t> numbers;
  std::vector<cgsize_t> faces, face_offsets = {0}, polyhedra, cell_offsets = {0}, left;
  for (const auto& hexahedron : block.hexahedra) {
    for (const auto& corners : sides) {
      std::set<std::uint32_t> sorted;
      for (const std::size_t corner : corners) sorted.insert(hexahedron[corner]);
      const auto [number, is_new] = numbers.try_emplace(sorted, static_cast<cgsize_t>(numbers.size()) + 1);
      polyhedra.push_back(is_new ? number->second : -number->second);
      if (!is_new) continue;
      for (const std::size_t corner : corners) faces.push_back(hexahedron[corner] + 1);
      face_offsets.push_back(static_cast<cgsize_t>(faces.size()));
      if (std::ranges::all_of(sorted, [&](std::uint32_t p) { return block.points[p].x == 0; }))
        left.push_back(number->second);
    }
    cell_offsets.push_back(static_cast<cgsize_t>(polyhedra.size()));
  }
  int file = 0, base = 0, zone = 0, solution = 0, ignored = 0;
  EXPECT_EQ(cg_open(path.c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
  cg_base_write(file, "Base", 3, 3, &base);
  const std::array<cgsize_t, 3> size = {block_points, block_cells, 0};
  cg_zone_write(file, base, "Zone", size.data(), CGNS_ENUMV(Unstructured), &zone);
  write_coordinates(file, base, zone, block);
  const auto count = static_cast<cgsize_t>(numbers.size());
  cg_poly_section_write(file, base, zone, "Faces", CGNS_ENUMV(NGON_n), 1, count, 0, faces.data(), face_offsets.data(),
                        &ignored);
  cg_poly_section_write(file, base, zone, "Cells", CGNS_ENUMV(NFACE_n), count + 1,
                        count + static_cast<cgsize_t>(block_cells), 0, polyhedra.data(), cell_offsets.data(), &ignored);
  cg_sol_write(file, base, zone, "Solution", CGNS_ENUMV(Vertex), &solution);
  std::vector<double> values;
  for (const dvec3& p : block.points) values.push_back(field(p, 0));
  cg_field_write(file, base, zone, solution, CGNS_ENUMV(RealDouble), "f", values.data(), &ignored);
  EXPECT_EQ(cg_close(file), 0) << cg_get_error();
  return left;
}

// The polygons of a condition are a patch, and all others are not: most are faces between two polyhedra.
TEST_F(BlocksTest, CgnsConditionsOfPolygonsArePatches) {
  const std::vector<cgsize_t> left = write_polyhedra(path("mesh.cgns"));
  ASSERT_EQ(left.size(), cells * cells);
  const auto input = value_of(read_input({path("mesh.cgns")}));
  EXPECT_EQ(input.census.cells.at("polyhedron"), block_cells);
  EXPECT_THAT(patches_of("mesh.cgns"), UnorderedElementsAre(Pair("outer", 108)));

  // A list, in which a number is no face's; a range of a face between two cells; and a range of many numbers.
  int file = 0, condition = 0;
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
  std::vector<cgsize_t> list = left;
  list.push_back(100'000);
  const auto put = [&](const char* name, CGNS_ENUMT(PointSetType_t) set, std::span<const cgsize_t> numbers) {
    cg_boco_write(file, 1, 1, name, CGNS_ENUMV(BCWall), set, static_cast<cgsize_t>(numbers.size()), numbers.data(),
                  &condition);
    cg_boco_gridlocation_write(file, 1, 1, condition, CGNS_ENUMV(FaceCenter));
  };
  put("Inlet", CGNS_ENUMV(PointList), list);
  put("Baffle", CGNS_ENUMV(PointRange), std::array<cgsize_t, 2>{2, 2});
  put("Nothing", CGNS_ENUMV(PointRange), std::array<cgsize_t, 2>{1'000'000, 1'000'000'000'000});
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  EXPECT_THAT(patches_of("mesh.cgns"), UnorderedElementsAre(Pair("Inlet", 18), Pair("Baffle", 2), Pair("outer", 90)));
}

TEST_F(BlocksTest, CgnsUnits) {
  write_cgns(path("mesh.cgns"));
  int file = 0;
  ASSERT_EQ(cg_open(path("mesh.cgns").c_str(), CG_MODE_MODIFY, &file), 0) << cg_get_error();
  const auto units = [&] {
    cg_units_write(CGNS_ENUMV(Kilogram), CGNS_ENUMV(Meter), CGNS_ENUMV(Second), CGNS_ENUMV(Kelvin), CGNS_ENUMV(Degree));
  };
  cg_goto(file, 1, "end");
  cg_dataclass_write(CGNS_ENUMV(Dimensional));
  units();
  const auto exponents = [&](int field_number, std::array<double, 5> powers) {
    cg_goto(file, 1, "Zone_t", 1, "FlowSolution_t", 2, "DataArray_t", field_number, "end");
    cg_exponents_write(CGNS_ENUMV(RealDouble), powers.data());
  };
  exponents(1, {1, -1, -2, 0, 0});
  exponents(2, {0, 1, -1, 0, 0});
  int ignored = 0;
  const std::vector<double> values(block_points, 1);
  for (const char* name : {"Density", "Mach"})
    cg_field_write(file, 1, 1, 2, CGNS_ENUMV(RealDouble), name, values.data(), &ignored);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  const auto source = value_of(open_source({path("mesh.cgns")}, {{"f", "U", "U[1]", "Density", "Mach"}, {}, {}}));
  EXPECT_THAT(source->units(), ElementsAre("Pa", "m/s", "m/s", "kg/m^3", ""));
}

TEST_F(BlocksTest, CgnsTruncated) {
  write_cgns(path("mesh.cgns"));
  expect_survives_truncation("mesh.cgns", "mesh.cgns", 499, all_cuts);
}

// OpenFOAM: one cube given by its faces, with fields at the cells' centres and a patch on its whole boundary.

std::string foam_file(const std::string& type, const std::string& name, const std::string& body) {
  return fmt::format("FoamFile\n{{\n  version 2.0;\n  format ascii;\n  class {};\n  object {};\n}}\n\n{}", type, name,
                     body);
}

/// The number of values, then the values in brackets.
template <class T, class Format>
std::string foam_list(const std::vector<T>& values, const Format& format) {
  std::string text = fmt::format("{}\n(\n", values.size());
  for (const T& value : values) text += format(value) + '\n';
  return text + ")\n";
}

struct FoamFace {
  std::array<std::uint32_t, 4> points;
  std::size_t owner;
  std::size_t neighbour;  // block_cells: none
};

/// The faces of the cube of a block, or of its cells [begin, end), inner ones first.
std::vector<FoamFace> foam_faces(std::size_t begin = 0, std::size_t end = block_cells) {
  constexpr std::array<std::size_t, 3> stride = {1, cells, cells * cells};
  std::vector<FoamFace> inner, outer;
  for (std::size_t cell = begin; cell < end; ++cell)
    for (std::size_t s = 0; s < 6; ++s) {
      FoamFace face{{}, cell - begin, block_cells};
      for (std::size_t i = 0; i < 4; ++i) face.points[i] = cubes[0].hexahedra[cell][sides[s][i]];
      const std::size_t index = cell / stride[s / 2] % cells;
      const bool lower = s % 2 == 0;
      if (index == (lower ? 0 : cells - 1) || (lower ? cell < begin + stride[s / 2] : cell + stride[s / 2] >= end)) {
        outer.push_back(face);
      } else if (!lower) {
        face.neighbour = cell - begin + stride[s / 2];
        inner.push_back(face);
      }
    }
  inner.insert(inner.end(), outer.begin(), outer.end());
  return inner;
}

/// Moves the points of a mesh.
using Place = std::function<dvec3(dvec3)>;

/// Writes the cells [begin, end) of the cube to a folder.
void write_openfoam_part(
    const TempFolder& folder, const std::string& part, std::size_t begin, std::size_t end,
    const Place& place = [](dvec3 p) { return p; }) {
  std::vector<FoamFace> faces = foam_faces(begin, end);
  std::vector<dvec3> points;  // those of the faces
  std::map<std::uint32_t, std::uint32_t> numbers;
  for (FoamFace& face : faces)
    for (std::uint32_t& point : face.points) {
      const auto [number, is_new] = numbers.try_emplace(point, static_cast<std::uint32_t>(points.size()));
      if (is_new) points.push_back(place(cubes[0].points[point]));
      point = number->second;
    }
  std::vector<std::size_t> owners, neighbours;
  for (const FoamFace& face : faces) {
    owners.push_back(face.owner);
    if (face.neighbour < block_cells) neighbours.push_back(face.neighbour);
  }
  const auto vector = [](dvec3 p) { return fmt::format("({} {} {})", p.x, p.y, p.z); };
  const auto number = [](auto value) { return fmt::format("{}", value); };
  const auto face_text = [](const FoamFace& face) {
    return fmt::format("4({} {} {} {})", face.points[0], face.points[1], face.points[2], face.points[3]);
  };
  const std::string mesh = part + "constant/polyMesh/";
  folder.write(mesh + "points", foam_file("vectorField", "points", foam_list(points, vector)));
  folder.write(mesh + "faces", foam_file("faceList", "faces", foam_list(faces, face_text)));
  folder.write(mesh + "owner", foam_file("labelList", "owner", foam_list(owners, number)));
  folder.write(mesh + "neighbour", foam_file("labelList", "neighbour", foam_list(neighbours, number)));
  folder.write(mesh + "boundary",
               foam_file("polyBoundaryMesh", "boundary",
                         fmt::format("1\n(\nwalls\n{{\n  type wall;\n  nFaces {};\n  startFace {};\n}}\n)\n",
                                     faces.size() - neighbours.size(), neighbours.size())));
  const std::string patches = "boundaryField\n{\n  walls\n  {\n    type zeroGradient;\n  }\n}\n";
  for (const double time : times) {
    std::vector<double> f;
    std::vector<dvec3> u;
    for (std::size_t cell = begin; cell < end; ++cell) {
      f.push_back(field(center(cubes[0], cell), time));
      u.push_back(f.back() * dvec3(1, 2, -1));
    }
    const auto body = [&](const std::string& type, const std::string& dimensions, const std::string& list) {
      return fmt::format("dimensions {};\ninternalField nonuniform List<{}>\n{};\n{}", dimensions, type, list, patches);
    };
    const std::string step = fmt::format("{}{}/", part, time);
    folder.write(step + "f",
                 foam_file("volScalarField", "f", body("scalar", "[0 2 -2 0 0 0 0]", foam_list(f, number))));
    folder.write(step + "U",
                 foam_file("volVectorField", "U", body("vector", "[0 1 -1 0 0 0 0]", foam_list(u, vector))));
  }
}

void write_openfoam_case(const TempFolder& folder) {
  folder.write("case.foam", "");
  folder.write("system/controlDict", foam_file("dictionary", "controlDict", "application icoFoam;\nstartTime 0;\n"));
}

void write_openfoam(const TempFolder& folder) {
  write_openfoam_case(folder);
  write_openfoam_part(folder, "", 0, block_cells);
}

/// The first `cut` cells on a processor, and the others on another one.
void write_processors(
    const TempFolder& folder, std::size_t cut, const Place& place = [](dvec3 p) { return p; }) {
  write_openfoam_case(folder);
  write_openfoam_part(folder, "processor0/", 0, cut, place);
  write_openfoam_part(folder, "processor1/", cut, block_cells, place);
}

TEST_F(BlocksTest, OpenFoam) {
  write_openfoam(*this);
  for (const char* name : {"case.foam", "system/controlDict", ""}) expect_cube(name, 1);
  EXPECT_EQ(value_of(read_input({path("case.foam")})).points, block_points) << "no patches";
  const auto last = value_of(read_input({path("case.foam")}));
  EXPECT_EQ(last.step->time, 2);
  expect_series(path("case.foam"), folder_, 2);
  EXPECT_THAT(patches_of("case.foam"), UnorderedElementsAre(Pair("walls", 108)));
}

TEST_F(BlocksTest, OpenFoamFieldsThatAreNotRead) {
  write_openfoam(*this);
  EXPECT_EQ(strict_error_of("case.foam"), "(no error)");
  write("2/phi", "FoamFile { version 2.0; format ascii; class surfaceScalarField; }\ninternalField uniform 1;\n");
  EXPECT_THAT(strict_error_of("case.foam"), HasSubstr("phi: left out: surfaceScalarField"));
}

TEST_F(BlocksTest, OpenFoamUnits) {
  write_openfoam(*this);
  const auto source = value_of(open_source({path("case.foam")}, {{"f", "U", "U[2]"}, {}, {}}));
  EXPECT_THAT(source->units(), ElementsAre("m^2/s^2", "m/s", "m/s"));
}

// Two processors, which cut the cube in the middle of a layer of cells.
TEST_F(BlocksTest, DecomposedOpenFoam) {
  write_processors(*this, 13);
  // As in the whole mesh: the means at common points are over the cells of both.
  for (const char* name : {"case.foam", ""}) expect_cube(name, 2);
  auto source = value_of(open_source({path("case.foam")}, {{"f"}, {}, {}}));
  EXPECT_THAT(source->units(), ElementsAre("m^2/s^2"));
  const auto report = value_of(build_volume(*source, path("out.svol"), {}, [](const char*, double) {}));
  EXPECT_EQ(report.resolution_counts.back(), block_points);
  expect_series(path("case.foam"), folder_, 2);
  EXPECT_EQ(points_with_cells("case.foam"), block_points) << "processors are no blocks";

  std::filesystem::rename(path("processor0"), path("processor2"));
  EXPECT_THAT(error_of("case.foam"), HasSubstr("the folder processor0 of the decomposed case is missing"));
  std::filesystem::rename(path("processor2"), path("processor0"));
  std::filesystem::remove_all(path("processor1/2"));
  EXPECT_THAT(error_of("case.foam"), HasSubstr("has no time step 2, which others have"));
  EXPECT_EQ(error_of("case.foam", {{}, {}, 0.5}), "(no error)");

  // A case that has the last step itself is read from there.
  write_openfoam_part(*this, "", 0, block_cells);
  const auto whole = value_of(read_input({path("case.foam")}));
  EXPECT_EQ(whole.pieces.size(), 1u);
}

// Two regions side by side, each on two processors.
TEST_F(BlocksTest, OpenFoamRegionsAreBlocks) {
  write_openfoam_case(*this);
  for (const auto& [processor, begin, end] :
       {std::tuple<std::string, std::size_t, std::size_t>{"processor0", 0, 13}, {"processor1", 13, block_cells}})
    for (const double x : {0, 1}) {
      write_openfoam_part(*this, "part/", begin, end, [x = x](dvec3 p) { return p + dvec3(x, 0, 0); });
      const std::string region = x == 0 ? "fluid" : "solid";
      for (const std::string step : {"constant", "0.5", "2"}) {
        std::filesystem::create_directories(path(processor + "/" + step));
        std::filesystem::rename(path("part/" + step), path(processor + "/" + step + "/" + region));
      }
    }
  std::filesystem::remove_all(path("part"));
  const auto input = value_of(read_input({path("case.foam")}));
  ASSERT_EQ(input.pieces.size(), 4u);
  std::map<std::uint64_t, std::size_t> pieces;
  for (const Piece& piece : input.pieces) ++pieces[piece.block];
  EXPECT_THAT(pieces, ElementsAre(Pair(Gt(0u), 2), Pair(Gt(0u), 2)));
  EXPECT_EQ(points_with_cells("case.foam"), 2 * block_points);
}

// Files of one mesh name the same blocks.
TEST_F(BlocksTest, PartsOfAnExodusMeshHaveTheSameBlocks) {
  ExodusMesh mesh = exodus_mesh();
  mesh.write(path("mesh.e.2.0"));
  for (dvec3& p : mesh.points) p.y += 1;
  for (ExodusBlock& block : mesh.blocks) block.cells.resize(block.cells.size() / 2);  // sizes may be in names
  mesh.of_cells.clear();
  mesh.write(path("mesh.e.2.1"));
  const auto input = value_of(read_input({path("mesh.e.2.0"), path("mesh.e.2.1")}));
  ASSERT_EQ(input.pieces.size(), 4u);
  EXPECT_EQ(input.pieces[0].block, input.pieces[2].block);
  EXPECT_EQ(input.pieces[1].block, input.pieces[3].block);
  EXPECT_NE(input.pieces[0].block, input.pieces[1].block);
}

/// A field of one value, in `cells` cells.
std::string foam_number(const std::string& name, double value) {
  return foam_file(
      "volScalarField", name,
      fmt::format("dimensions [0 0 0 0 0 0 0];\ninternalField uniform {};\nboundaryField\n{{\n  walls\n  {{\n    "
                  "type zeroGradient;\n  }}\n}}\n",
                  value));
}

TEST_F(BlocksTest, OpenFoamFieldsOfOneProcessor) {
  write_processors(*this, 13);
  write("processor1/2/k", foam_number("k", 7));
  for (const CellValues kind : {CellValues::averaged, CellValues::own}) {
    const auto input = value_of(read_input({path("case.foam")}, {{}, {}, {}, kind}));
    EXPECT_THAT(input.attributes, UnorderedElementsAre("f", "U", "U[0]", "U[1]", "U[2]", "k"));
    EXPECT_THAT(values_in(input, 0, "k"), AreMissing());
    EXPECT_THAT(values_in(input, 1, "k"), Each(7));
  }
  write("processor0/2/k", foam_file("volVectorField", "k",
                                    "dimensions [0 0 0 0 0 0 0];\ninternalField uniform (1 2 3);\n"
                                    "boundaryField\n{\n  walls\n  {\n    type zeroGradient;\n  }\n}\n"));
  for (const CellValues kind : {CellValues::averaged, CellValues::own})
    EXPECT_THAT(error_of("case.foam", {{}, {}, {}, kind}), HasSubstr("the array \"k\" is a "));
}

TEST_F(BlocksTest, OpenFoamFieldsOfOneStep) {
  write_openfoam(*this);
  write("2/k", foam_number("k", 7));
  const InputReader reader{open_source, list_arrays};
  auto steps = value_of(steps_of_input({path("")}, {}, parse_times("all").value(), reader));
  const auto built = value_of(build_series(std::move(steps), path("all.svol"), {}, [](const char*, double) {}));
  EXPECT_THAT(built.build.missing, Contains(Pair("k", block_points)));
  // The last step as an append to the first.
  auto first = steps_of_input({path("")}, {}, parse_times(":1").value(), reader);
  ASSERT_TRUE(build_series(std::move(first.value()), path("grown.svol"), {}, [](const char*, double) {}));
  EXPECT_THAT(
      message_of(steps_of_input({path("")}, {}, parse_times("1:").value(), reader, {"U", "U[0]", "U[1]", "U[2]", "f"})),
      HasSubstr("the series does not have the attribute \"k\""));
}

/// The values of an attribute at all positions; of a position that several pieces have, their values.
std::map<std::array<double, 3>, std::vector<double>> values_by_position(const Input& input, const std::string& name) {
  std::map<std::array<double, 3>, std::vector<double>> values;
  for (const Piece& piece : input.pieces)
    for (std::size_t i = 0; i < piece.points.size(); ++i)
      values[{piece.points[i].x, piece.points[i].y, piece.points[i].z}].push_back(
          piece.values.at(input.index_of(name))[i]);
  return values;
}

/// Expects that a mesh in several pieces has the values of the whole one, also where pieces touch.
void expect_same_values(const Input& whole, const Input& parts, const std::string& name) {
  const auto expected = values_by_position(whole, name), found = values_by_position(parts, name);
  ASSERT_EQ(found.size(), expected.size());
  std::size_t common = 0;
  for (const auto& [position, values] : found) {
    ASSERT_TRUE(expected.contains(position));
    common += values.size() > 1 ? 1 : 0;
    for (const double value : values) {
      EXPECT_EQ(value, values[0]) << "else the points do not merge into one";
      EXPECT_NEAR(value, expected.at(position)[0], 1e-12);
    }
  }
  EXPECT_GE(common, side);
}

// Values that the user names as missing do not count in the means of several processors either.
TEST_F(BlocksTest, DecomposedOpenFoamWithMissingValues) {
  write_openfoam_case(*this);
  constexpr std::size_t cut = 13;
  write_openfoam_part(*this, "", 0, block_cells);
  write_openfoam_part(*this, "processor1/", cut, block_cells);
  // The first value of the second processor.
  const std::string field = read_text_file(path("processor1/2/f")).value();
  const double named = std::stod(field.substr(field.find('(') + 1));
  const SourceOptions options = {{"f"}, {}, {}, CellValues::averaged, {named}};
  const auto whole = value_of(read_input({path("case.foam")}, options));
  std::filesystem::remove_all(path("constant"));
  write_openfoam_part(*this, "processor0/", 0, cut);
  const auto parts = value_of(read_input({path("case.foam")}, options));
  ASSERT_EQ(parts.pieces.size(), 2u);
  EXPECT_EQ(parts.pieces[0].fills[0] + parts.pieces[1].fills[0], 1u);
  expect_same_values(whole, parts, "f");
}

// The means are by volume, also over the cells of several processors.
TEST_F(BlocksTest, DecomposedOpenFoamWithCellsOfDifferentVolumes) {
  const Place graded = [](dvec3 p) { return p * p * p; };
  write_openfoam_case(*this);
  write_openfoam_part(*this, "", 0, block_cells, graded);
  const auto whole = value_of(read_input({path("case.foam")}));
  ASSERT_EQ(whole.pieces.size(), 1u);
  std::filesystem::remove_all(path("constant"));
  write_processors(*this, 13, graded);
  const auto parts = value_of(read_input({path("case.foam")}));
  ASSERT_EQ(parts.pieces.size(), 2u);
  for (const char* name : {"f", "U", "U[1]"}) {
    SCOPED_TRACE(name);
    expect_same_values(whole, parts, name);
  }
  auto source = value_of(open_source({path("case.foam")}, {}));
  while (*source->next()) {
  }
  EXPECT_EQ(source->conversions().size(), 1u);

  const auto cells_alone = value_of(read_input({path("case.foam")}, {.cells = CellValues::own}));
  EXPECT_EQ(cells_alone.points, block_cells);
}

// Coordinates of a map, which single precision would bend.
TEST_F(BlocksTest, OpenFoamIsReadInDouble) {
  const Place far_away = [](dvec3 p) { return p + dvec3(5e5, 4.5e6, 0); };
  write_openfoam_case(*this);
  for (const std::string& part : {std::string(), std::string("processor0/")}) {
    write_openfoam_part(*this, part, 0, block_cells, far_away);
    EXPECT_EQ(strict_error_of("case.foam"), "(no error)");
    EXPECT_NEAR(value_of(read_input({path("case.foam")})).volume, 1, 1e-8);
    const auto input = value_of(read_input({path("case.foam")}, {.cells = CellValues::own}));
    const std::vector<double> values = values_in(input, 0, "f");
    ASSERT_EQ(values.size(), block_cells);
    for (std::size_t cell = 0; cell < block_cells; ++cell)
      EXPECT_EQ(values[cell], field(center(cubes[0], cell), 2)) << "not rounded";
    std::filesystem::remove_all(path("constant"));
  }
}

/// The last bits of a coordinate that depend on the other coordinates, as blockMesh makes them.
dvec3 noisy(dvec3 p) {
  const dvec3 noise = glm::sin(1e3 * dvec3(p.y + 2 * p.z, p.z + 2 * p.x, p.x + 2 * p.y));
  return p * (1.0 + 0x1p-51 * noise);
}

std::vector<dvec3> points_of(const Input& input) {
  std::vector<dvec3> points;
  for (const Piece& piece : input.pieces) points.insert(points.end(), piece.points.begin(), piece.points.end());
  return points;
}

TEST_F(BlocksTest, OpenFoamLosesNoiseInLastBits) {
  for (const bool whole : {true, false}) {
    const auto points_at = [&](const Place& place, bool may_round) {
      if (whole) {
        write_openfoam_case(*this);
        write_openfoam_part(*this, "", 0, block_cells, place);
      } else {
        write_processors(*this, 13, place);
      }
      const auto input = value_of(read_input({path("case.foam")}, {.may_round = may_round}));
      EXPECT_EQ(input.census.rounded_by, may_round ? 0x1p-40 : 0);
      return points_of(input);
    };
    const Place as_is = [](dvec3 p) { return p; };
    const std::vector<dvec3> clean = points_at(as_is, false), rounded = points_at(as_is, true);
    EXPECT_FALSE(points_at(noisy, false) == clean);
    EXPECT_TRUE(points_at(noisy, true) == rounded);
    for (std::size_t i = 0; i < clean.size(); ++i)
      for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(clean[i][axis], rounded[i][axis], 0x1p-40);
    std::filesystem::remove_all(path("constant"));
  }
}

/// A layer that is too thin lies on the second processor, or in the second region: the points of the first stay, too.
TEST_F(BlocksTest, OpenFoamIsRoundedAsAWholeOrNotAtAll) {
  for (const double thickness : {4200 * 0x1p-39, 4000 * 0x1p-39}) {
    write_processors(*this, 13, [&](dvec3 p) { return noisy({p.x, p.y, p.z > 0.9 ? 2.0 / 3 + thickness : p.z}); });
    const auto input = value_of(read_input({path("case.foam")}, {.may_round = true}));
    ASSERT_EQ(input.pieces.size(), 2u);
    EXPECT_EQ(input.census.rounded_by > 0, thickness > 4096 * 0x1p-39);
    for (const Piece& piece : input.pieces) EXPECT_EQ(piece.census.rounded_by > 0, thickness > 4096 * 0x1p-39);
    const auto source = value_of(open_source({path("case.foam")}, {.may_round = true}));
    const auto report = value_of(build_volume(*source, path("out.svol"), {}, [](const char*, double) {}));
    EXPECT_EQ(report.resolution_counts.back(), block_points) << "nothing is torn";
  }
  write_openfoam_case(*this);
  for (const std::string region : {"fluid", "solid"}) {
    write_openfoam_part(*this, "part/", 0, block_cells, [&](dvec3 p) {
      return noisy(region == "fluid" ? p : dvec3(p.x + 1, p.y, p.z > 0.9 ? 2.0 / 3 + 1e-9 : p.z));
    });
    for (const std::string step : {"constant", "0.5", "2"}) {
      std::filesystem::create_directories(path(step));
      std::filesystem::rename(path("part/" + step), path(step + "/" + region));
    }
  }
  for (const char* processor : {"part", "processor0", "processor1"}) std::filesystem::remove_all(path(processor));
  EXPECT_EQ(value_of(read_input({path("case.foam")}, {.may_round = true})).census.rounded_by, 0);
}

TEST_F(BlocksTest, TheStatedErrorCountsTheRoundingOfOpenFoam) {
  write_processors(*this, 13, noisy);
  constexpr double rounded_by = 0x1p-40;
  double rounded = 0;
  for (const bool may_round : {true, false})
    for (const bool exact : {true, false}) {
      const auto source = value_of(open_source({path("case.foam")}, {.may_round = may_round}));
      const BuildOptions options{.exact = {.positions = exact}};
      ASSERT_EQ(message_of(build_volume(*source, path("out.svol"), options, [](const char*, double) {})), "");
      const double error = value_of(format::Volume::open(value_of(open_file(path("out.svol")))))->info().position_error;
      if (exact)
        EXPECT_EQ(error, may_round ? rounded_by : 0);
      else if (may_round)
        rounded = error;
      else
        EXPECT_EQ(rounded, error + rounded_by);
    }
}

TEST_F(BlocksTest, RoundedEnSightIsTold) {
  write_ensight(*this);
  const std::string geometry = read_text_file(path("mesh.geo")).value();
  EXPECT_EQ(strict_error_of("mesh.case"), "(no error)");
  // Moves all points in x, or writes them as a binary file would hold them.
  for (const bool rounded : {false, true}) {
    std::string moved;
    std::istringstream lines(geometry);
    std::size_t left = 0;
    for (std::string line, before; std::getline(lines, line); before = line) {
      const bool is_count = before == "coordinates";
      if (left > 0) {
        const double x = std::stod(line) + 4.5e6;
        line = fmt::format("{:.10g}", rounded ? static_cast<float>(x) : x);
        line += line.find('.') == std::string::npos ? ".0" : "";
        --left;
      }
      if (is_count) left = std::stoul(line);
      moved += line + "\n";
    }
    write("mesh.geo", moved);
    const std::string error = strict_error_of("mesh.case");
    if (rounded)
      EXPECT_THAT(error, Not(HasSubstr("single precision")));
    else
      EXPECT_THAT(error, HasSubstr("the reader rounds coordinates to single precision"));
  }
}

TEST_F(BlocksTest, DecomposedOpenFoamTruncated) {
  write_processors(*this, 9);
  for (const char* name : {"points", "faces", "owner", "neighbour", "boundary"}) {
    SCOPED_TRACE(name);
    expect_survives_truncation(fmt::format("processor1/constant/polyMesh/{}", name), "case.foam", 61);
  }
  expect_survives_truncation("processor1/2/f", "case.foam", 97);
}

TEST_F(BlocksTest, OpenFoamTruncated) {
  write_openfoam(*this);
  for (const char* name : {"constant/polyMesh/points", "constant/polyMesh/faces", "constant/polyMesh/owner",
                           "constant/polyMesh/neighbour", "constant/polyMesh/boundary", "2/f"})
    expect_survives_truncation(name, "case.foam", 61);
}

// Other inputs have no time steps. Errors of empty and foreign files begin with their names.
TEST_F(BlocksTest, TimeAndForeignFiles) {
  EXPECT_EQ(error_of("no.cgns").find(path("no.cgns")), 0u);
  EXPECT_EQ(message_of(open_source({"gen:points:count=10"}, {{}, {}, 1.0})),
            "gen:points:count=10: no time steps in it to choose from");
  for (const char* name : {"a.e", "a.exo", "a.case", "a.cgns", "a.foam"})
    for (const char* text : {"", "Not what the name says.\n"}) {
      write(name, text);
      EXPECT_THAT(error_of(name), StartsWith(path(name) + ": "));
    }
}

}  // namespace
}  // namespace splatvol::test
