// Cells of their own, whole cells and cells of a series, as files keep them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/mesh/heights.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/opened_files.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/surgery.h"
#include "tests/support/temp_folder.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using format::CellField;
using format::CellReader;
using format::CellShape;
using testing::HasSubstr;

const auto silent = [](const char*, double) {};

struct KeptCells : FolderTest {
  std::shared_ptr<const format::Volume> build(const std::string& input, const SourceOptions& source_options,
                                              bool exact = true) const {
    const auto source = value_of(open_source({path(input)}, source_options));
    BuildOptions options{.exact = {.positions = exact, .values = exact}, .keep_cells = true};
    report_ = value_of(build_volume(*source, path("out.svol"), options, silent));
    return open_checked(path("out.svol"));
  }

  mutable BuildReport report_;
};

// Calls visit(chunk, cell, corners) for all cells.
template <class Visit>
void for_each_cell(const CellReader& cells, const Visit& visit) {
  format::RankedPoints points(cells, own_room(1 << 20));
  format::CellVertices vertices([&](std::size_t page) { return cells.read_vertex_page(page); }, own_room(1 << 20));
  for (const format::CellChunk& chunk : chunks_of(cells))
    for (std::size_t cell = 0; cell < chunk.size(); ++cell) {
      std::vector<format::RankedPoints::Place> places;
      std::vector<dvec3> corners;
      if (chunk.field == CellField::constant) {
        EXPECT_TRUE(vertices.read_positions(chunk.corners_at(cell), corners));
      } else {
        EXPECT_TRUE(points.find(chunk.corners_at(cell), places));
        EXPECT_TRUE(points.read_positions(places, corners));
      }
      visit(chunk, cell, corners);
    }
}

// A lattice of n^3 cubes of edge 1, with a value of each.
std::string lattice_of_cells(int n) {
  std::string text = fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS {0} {0} {0}\nORIGIN 0 0 0\n"
      "SPACING 1 1 1\nCELL_DATA {1}\nSCALARS p double 1\nLOOKUP_TABLE default\n",
      n + 1, n * n * n);
  for (int i = 0; i < n * n * n; ++i) text += fmt::format("{}\n", i);
  return text;
}

TEST_F(KeptCells, OfTheirOwnHaveOneValueAndTheMeshsCorners) {
  constexpr int n = 9;
  write("cells.vtk", lattice_of_cells(n));
  for (const bool exact : {true, false}) {
    const auto volume = build("cells.vtk", {.cells = CellValues::own}, exact);
    const auto cells = value_of(CellReader::open(*volume));
    ASSERT_EQ(cells->kinds().size(), 1u);
    EXPECT_EQ(cells->kinds()[0].shape, CellShape::hexahedron);
    EXPECT_EQ(cells->kinds()[0].field, CellField::constant);
    EXPECT_EQ(cells->kinds()[0].cells, static_cast<std::uint64_t>(n * n * n));
    EXPECT_EQ(cells->vertex_count(), static_cast<std::uint64_t>((n + 1) * (n + 1) * (n + 1)));
    format::RankedPoints points(*cells, own_room(1 << 20));
    format::CellVertices vertices([&](std::size_t page) { return cells->read_vertex_page(page); }, own_room(1 << 20));
    std::set<int> found;
    for (const format::CellChunk& chunk : chunks_of(*cells)) {
      std::vector<format::RankedPoints::Place> places;
      std::vector<float> values;
      ASSERT_TRUE(points.find(chunk.points, places));
      ASSERT_TRUE(points.read_values(places, 0, values));
      for (std::size_t cell = 0; cell < chunk.size(); ++cell) {
        std::vector<dvec3> corners;
        ASSERT_TRUE(vertices.read_positions(chunk.corners_at(cell), corners));
        Box box;
        for (const dvec3& corner : corners) box.include(corner);
        const double moved = exact ? 0 : 0.01;
        EXPECT_LE(glm::length(box.extent() - dvec3(1)), moved);
        const dvec3 at = glm::round(box.low);
        EXPECT_LE(glm::length(box.low - at), moved);
        const double value = volume->info().attributes[0].value(double{values[cell]});
        EXPECT_NEAR(value, at.x + n * (at.y + n * at.z), exact ? 0 : 0.6);
        found.insert(static_cast<int>(std::lround(value)));
      }
    }
    if (exact) {
      EXPECT_EQ(found.size(), static_cast<std::size_t>(n * n * n));
    }
  }
}

// One of each shape.
constexpr const char* shapes = R"(# vtk DataFile Version 3.0
test
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 17 double
0 0 0  1 0 0  1 1 0  0 1 0  0 0 1  1 0 1  1 1 1  0 1 1
.5 .5 2
2 0 0  2 1 0  2 .5 1
3 0 0  3 1 0  3 .5 1
5 5 5  6 5 5
CELLS 4 27
8 0 1 2 3 4 5 6 7
5 4 5 6 7 8
6 9 10 11 12 13 14
4 0 1 15 16
CELL_TYPES 4
12
14
13
10
POINT_DATA 17
SCALARS p double 1
LOOKUP_TABLE default
0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16
)";

TEST_F(KeptCells, OfEachShapeFillWhatTheyFill) {
  write("shapes.vtk", shapes);
  const auto volume = build("shapes.vtk", {});
  const auto cells = value_of(CellReader::open(*volume));
  std::multiset<CellShape> kinds;
  for (const format::CellKind& kind : cells->kinds()) {
    EXPECT_EQ(kind.cells, 1u);
    EXPECT_EQ(kind.field, CellField::corners);
    kinds.insert(kind.shape);
  }
  EXPECT_EQ(kinds, (std::multiset<CellShape>{CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge,
                                             CellShape::hexahedron}));
  const std::map<CellShape, double> volumes = {
      {CellShape::hexahedron, 1}, {CellShape::pyramid, 1.0 / 3}, {CellShape::wedge, 0.5}};
  for_each_cell(*cells, [&](const format::CellChunk& chunk, std::size_t cell, const std::vector<dvec3>& corners) {
    double sum = 0;
    for (const auto& [a, b, c, d] : format::tetrahedra_of(chunk.shape, chunk.split_at(cell)))
      sum += std::abs(glm::dot(corners[b] - corners[a], glm::cross(corners[c] - corners[a], corners[d] - corners[a])));
    if (const auto expected = volumes.find(chunk.shape); expected != volumes.end()) {
      EXPECT_NEAR(sum / 6, expected->second, 1e-12);
    }
  });
  // The cells are the same if the nodes of a cell are listed in another order.
  const std::uint64_t hash = volume->info().cells->hash;
  const std::string turned = replaced(shapes, "8 0 1 2 3 4 5 6 7", "8 1 2 3 0 5 6 7 4");
  write("turned.vtk", turned);
  EXPECT_EQ(build("turned.vtk", {})->info().cells->hash, hash);
  write("other.vtk", replaced(turned, "4 0 1 15 16", "4 0 2 15 16"));
  EXPECT_NE(build("other.vtk", {})->info().cells->hash, hash);
}

using Faces = std::vector<std::vector<int>>;

// Puts `copy` of a corner between the corner and `other` in the faces that have this edge.
void double_corner(int corner, int other, int copy, Faces& faces) {
  for (std::vector<int>& face : faces) {
    const auto at = std::ranges::find(face, corner);
    if (at == face.end()) continue;
    const std::size_t k = static_cast<std::size_t>(at - face.begin()), count = face.size();
    if (face[(k + 1) % count] == other)
      face.insert(at + 1, copy);
    else if (face[(k + count - 1) % count] == other)
      face.insert(at, copy);
  }
}

// A lattice of n^3 cubes as polyhedra, with a value of each and of each point. `turn`: lists faces otherwise. Each cube
// has a corner twice in the first `doubled` cubes: an edge without length.
std::string lattice_of_polyhedra(int n, bool turn = false, int doubled = 0) {
  const auto node = [&](int x, int y, int z) { return x + (n + 1) * (y + (n + 1) * z); };
  std::string points, cells, types, values, of_cells;
  const int nodes = (n + 1) * (n + 1) * (n + 1);
  std::vector<dvec3> positions;
  for (int z = 0; z <= n; ++z)
    for (int y = 0; y <= n; ++y)
      for (int x = 0; x <= n; ++x) positions.push_back(dvec3(x, y, z) + 0.1 * glm::sin(dvec3(y + z, x + 2 * z, x - y)));
  int numbers = 0, cell = 0;
  for (int z = 0; z < n; ++z)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x, ++cell) {
        const auto corner = [&](int k) {  // as VTK numbers them
          return node(x + (k % 4 == 1 || k % 4 == 2 ? 1 : 0), y + (k % 4 > 1 ? 1 : 0), z + k / 4);
        };
        Faces faces = {{0, 4, 7, 3}, {1, 2, 6, 5}, {0, 1, 5, 4}, {3, 7, 6, 2}, {0, 3, 2, 1}, {4, 5, 6, 7}};
        for (std::vector<int>& face : faces)
          for (int& k : face) k = corner(k);
        if (cell < doubled) {
          positions.push_back(positions[static_cast<std::size_t>(corner(6))]);
          double_corner(corner(6), corner(5), nodes + cell, faces);
        }
        if (turn) {
          std::ranges::reverse(faces);
          for (std::vector<int>& face : faces) std::ranges::rotate(face, face.begin() + 1 + cell % 2);
        }
        int count = 1;
        std::string text;
        for (const std::vector<int>& face : faces) {
          text += fmt::format(" {} {}", face.size(), fmt::join(face, " "));
          count += 1 + static_cast<int>(face.size());
        }
        cells += fmt::format("{} {}{}\n", count, faces.size(), text);
        numbers += 1 + count;
        types += "42\n";
        of_cells += fmt::format("{}\n", cell);
      }
  for (const dvec3& p : positions) {
    points += fmt::format("{} {} {}\n", p.x, p.y, p.z);
    values += fmt::format("{}\n", p.x + 2 * p.y + p.z);
  }
  return fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {0} double\n{1}"
      "CELLS {2} {3}\n{4}CELL_TYPES {2}\n{5}POINT_DATA {0}\nSCALARS p double 1\n"
      "LOOKUP_TABLE default\n{6}CELL_DATA {2}\nSCALARS c double 1\nLOOKUP_TABLE default\n{7}",
      positions.size(), points, n * n * n, numbers, cells, types, values, of_cells);
}

double volume_of(const CellReader& cells, std::vector<double>& volumes) {
  double sum = 0;
  for_each_cell(cells, [&](const format::CellChunk& chunk, std::size_t cell, const std::vector<dvec3>& corners) {
    double volume = 0;
    format::for_each_tetrahedron(chunk, cell, [&](const std::array<std::uint8_t, 4>& at) {
      const dvec3 a = corners[at[0]];
      volume += std::abs(glm::dot(corners[at[1]] - a, glm::cross(corners[at[2]] - a, corners[at[3]] - a))) / 6;
    });
    volumes.push_back(volume);
    sum += volume;
  });
  return sum;
}

// Hexahedra and wedges in thin layers, sheared so that a layer's corners are far from those above.
std::string thin_layers() {
  constexpr int width = 8, layers = 8;
  const auto node = [](int x, int y, int z) { return x + (width + 1) * (y + (width + 1) * z); };
  std::string points, values, cells, types, of_cells;
  int count = 0, numbers = 0;
  double height = 0;
  for (int z = 0; z <= layers; ++z) {
    for (int y = 0; y <= width; ++y)
      for (int x = 0; x <= width; ++x) {
        const double shift = 0.37 * z;
        points += fmt::format("{} {} {}\n", x + shift, y - shift, height + 0.3 * std::sin(x + shift) + 0.2 * y);
        values += fmt::format("{}\n", x + 2 * y + z);
      }
    height += z % 3 == 0 ? 1e-3 : z % 3 == 1 ? 0.02 : 0.4;
  }
  const auto add = [&](const std::vector<int>& nodes, int type) {
    cells += fmt::format("{} {}\n", nodes.size(), fmt::join(nodes, " "));
    types += fmt::format("{}\n", type);
    of_cells += fmt::format("{}\n", count++);
    numbers += 1 + static_cast<int>(nodes.size());
  };
  for (int z = 0; z < layers; ++z)
    for (int y = 0; y < width; ++y)
      for (int x = 0; x < width; ++x) {
        const int a = node(x, y, z), b = node(x + 1, y, z), c = node(x + 1, y + 1, z), d = node(x, y + 1, z);
        const int up = node(0, 0, 1);
        if ((x + y) % 2 == 0) {
          add({a, b, c, d, a + up, b + up, c + up, d + up}, 12);
        } else {
          add({a, b, c, a + up, b + up, c + up}, 13);
          add({a, c, d, a + up, c + up, d + up}, 13);
        }
      }
  return fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {0} double\n{1}"
      "CELLS {2} {3}\n{4}CELL_TYPES {2}\n{5}POINT_DATA {0}\nSCALARS p double 1\n"
      "LOOKUP_TABLE default\n{6}CELL_DATA {2}\nSCALARS c double 1\nLOOKUP_TABLE default\n{7}",
      node(0, 0, layers + 1), points, count, numbers, cells, types, values, of_cells);
}

// The corners of whole cells, be they points or vertices of their own.
TEST_F(KeptCells, OfThinLayersKeepTheirHeights) {
  write("layers.vtk", thin_layers());
  for (const CellValues values : {CellValues::averaged, CellValues::own}) {
    const auto corners_of = [&](bool exact) {
      const auto volume = build("layers.vtk", {.cells = values}, exact);
      EXPECT_EQ(report_.kept_cells->turned, 0u);
      std::vector<dvec3> of_tetrahedra;  // four after each other
      for_each_cell(*value_of(CellReader::open(*volume)),
                    [&](const format::CellChunk& chunk, std::size_t cell, const std::vector<dvec3>& corners) {
                      format::for_each_tetrahedron(chunk, cell, [&](const std::array<std::uint8_t, 4>& at) {
                        for (const std::uint8_t k : at) of_tetrahedra.push_back(corners[k]);
                      });
                    });
      return of_tetrahedra;
    };
    const std::vector<dvec3> exact = corners_of(true), rounded = corners_of(false);
    ASSERT_EQ(exact.size(), rounded.size());
    EXPECT_FALSE(exact == rounded);
    for (std::size_t i = 0; i < exact.size(); i += 4) {
      const auto height = [i](const std::vector<dvec3>& p) { return least_height(p[i], p[i + 1], p[i + 2], p[i + 3]); };
      EXPECT_GE(height(rounded), height(exact) * (1 - 1.0 / 64));
      for (std::size_t k = i; k < i + 4; ++k) EXPECT_LE(glm::length(rounded[k] - exact[k]), height(exact) / 256);
    }
  }
}

TEST_F(KeptCells, PolyhedraAreKeptAsSuch) {
  constexpr int n = 8;
  write("polyhedra.vtk", lattice_of_polyhedra(n));
  write("turned.vtk", lattice_of_polyhedra(n, true));
  for (const CellValues values : {CellValues::averaged, CellValues::own}) {
    const bool own = values == CellValues::own;
    const auto volume = build("polyhedra.vtk", {.cells = values});
    const auto cells = value_of(CellReader::open(*volume));
    ASSERT_EQ(cells->kinds().size(), 1u);
    EXPECT_EQ(cells->kinds()[0].shape, CellShape::polyhedron);
    EXPECT_EQ(cells->kinds()[0].field, own ? CellField::constant : CellField::corners);
    EXPECT_EQ(cells->kinds()[0].cells, static_cast<std::uint64_t>(n * n * n));
    EXPECT_EQ(cells->kinds()[0].turned, 0u);
    EXPECT_EQ(report_.kept_cells->collapsed, 0u);
    std::vector<double> volumes;
    EXPECT_NEAR(volume_of(*cells, volumes), report_.kept_cells->volume, 1e-9 * n * n * n);
    EXPECT_GT(std::ranges::min(volumes), 0.5);
    EXPECT_LT(std::ranges::max(volumes), 1.6);
    // Faces and their corners in another order are the same cells.
    EXPECT_EQ(build("turned.vtk", {.cells = values})->info().cells->hash, volume->info().cells->hash);
  }
}

TEST_F(KeptCells, PolyhedraDoNotDependOnMemoryAndThreads) {
  write("polyhedra.vtk", lattice_of_polyhedra(15));
  for (const CellValues values : {CellValues::averaged, CellValues::own}) {
    const auto source = [&] { return value_of(open_source({path("polyhedra.vtk")}, {.cells = values})); };
    ASSERT_EQ(message_of(build_volume(*source(), path("first.svol"), {.keep_cells = true}, silent)), "");
    for (const std::size_t threads : {1, 4}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      ASSERT_EQ(
          message_of(build_volume(*source(), path("other.svol"), {.memory = 1 << 20, .keep_cells = true}, silent)), "");
      EXPECT_TRUE(read_text_file(path("first.svol")).value() == read_text_file(path("other.svol")).value());
    }
  }
}

// Two corners become one point, as there are two pieces: such a polyhedron is kept as its tetrahedra that have a
// volume. The second piece has the first cube once more.
TEST_F(KeptCells, PolyhedraThatLoseACornerAreKeptAsTetrahedra) {
  write("cube.vtk", lattice_of_polyhedra(1));
  double plain = 0;
  for (const int doubled : {0, 5}) {
    write("lattice.vtk", lattice_of_polyhedra(4, false, doubled));
    const auto source = value_of(open_source({path("lattice.vtk"), path("cube.vtk")}, {.selection = {"p"}}));
    BuildOptions options{.exact = {.positions = true, .values = true}, .keep_cells = true};
    const BuildReport report = value_of(build_volume(*source, path("out.svol"), options, silent));
    const auto volume = open_checked(path("out.svol"));
    EXPECT_EQ(volume->info().point_count(), 125u);
    const auto cells = value_of(CellReader::open(*volume));
    ASSERT_EQ(cells->kinds().size(), doubled > 0 ? 2u : 1u);
    EXPECT_EQ(cells->kinds().back().shape, CellShape::polyhedron);
    EXPECT_EQ(cells->kinds().back().cells, static_cast<std::uint64_t>(65 - doubled));
    EXPECT_EQ(report.kept_cells->collapsed > 0, doubled > 0);
    std::vector<double> volumes;
    const double sum = volume_of(*cells, volumes);
    if (doubled == 0) plain = sum;
    EXPECT_NEAR(sum, plain, 1e-9);
  }
}

double field(std::size_t step, dvec3 p) { return static_cast<double>(step + 1) * (p.x + 2 * p.y) + p.z; }

std::vector<Piece> pieces_of(std::size_t step) {
  const Mesh mesh = lattice(8, [](dvec3 p) { return dvec3(p.x * p.x, p.y, 0.3 * p.z); });
  return cut(mesh_piece(mesh, [&](dvec3 p) { return field(step, p); }), 3);
}

std::vector<SeriesStep> steps(std::size_t begin, std::size_t end) {
  std::vector<SeriesStep> list;
  for (std::size_t step = begin; step < end; ++step)
    list.push_back(step_of(fmt::format("step {}", step), static_cast<double>(step), pieces_of(step)));
  return list;
}

// What a file tells of its chunks, with the ranges of the present step.
std::vector<std::string> summaries_of(const format::Volume& volume) {
  const auto cells = value_of(CellReader::open(volume));
  std::vector<std::string> lines;
  for (std::size_t page = 0; page < cells->pages().size(); ++page) {
    const auto read = value_of(cells->read_page(page, {0, -1}));
    for (std::size_t chunk = 0; chunk < read.chunks.size(); ++chunk)
      lines.push_back(fmt::format("{} {:016x} {} {} {:016x}", read.chunks[chunk].cells, read.chunks[chunk].hash,
                                  read.summaries[chunk].min, read.summaries[chunk].max,
                                  read.summaries[chunk].occupancy));
  }
  return lines;
}

TEST_F(KeptCells, OfASeriesAreThoseOfEachStep) {
  const BuildOptions options{.keep_cells = true}, little{.memory = 1 << 20, .keep_cells = true};
  ASSERT_EQ(message_of(build_series(steps(0, 4), path("series.svol"), options, silent)), "");
  ASSERT_EQ(message_of(build_series(steps(0, 4), path("apart.svol"), little, silent)), "");
  EXPECT_TRUE(read_text_file(path("series.svol")).value() == read_text_file(path("apart.svol")).value());
  ASSERT_EQ(message_of(build_series(steps(0, 2), path("grown.svol"), options, silent)), "");
  ASSERT_EQ(message_of(append_to_series(steps(2, 4), path("grown.svol"), {}, silent)), "");
  const auto series = open_checked(path("series.svol")), grown = open_checked(path("grown.svol"));
  for (std::size_t step = 0; step < 4; ++step) {
    PieceSource source(pieces_of(step));
    ASSERT_EQ(message_of(build_volume(source, path("single.svol"), options, silent)), "");
    const auto single = open_checked(path("single.svol"));
    EXPECT_EQ(series->info().cells->hash, single->info().cells->hash);
    EXPECT_EQ(summaries_of(*value_of(series->at_step(step))), summaries_of(*single)) << step;
    EXPECT_EQ(summaries_of(*value_of(grown->at_step(step))), summaries_of(*single)) << step;
  }
}

// The same points, and a cell less.
TEST_F(KeptCells, OfASeriesDoNotChange) {
  ASSERT_EQ(message_of(build_series(steps(0, 1), path("series.svol"), {.keep_cells = true}, silent)), "");
  std::vector<Piece> pieces = pieces_of(1);
  pieces[0].tetrahedra.pop_back();
  EXPECT_FALSE(append_to_series({step_of("step 1", 1, pieces)}, path("series.svol"), {}, silent));
  EXPECT_EQ(open_checked(path("series.svol"))->series()->steps.size(), 1u);
}

TEST_F(KeptCells, OfAnAppendAreThoseOfTheFile) {
  for (const bool keeps : {true, false}) {
    ASSERT_EQ(message_of(build_series(steps(0, 1), path("series.svol"), {.keep_cells = keeps}, silent)), "");
    ASSERT_EQ(message_of(append_to_series(steps(1, 2), path("series.svol"), {.keep_cells = !keeps}, silent)), "");
    const auto series = open_checked(path("series.svol"));
    EXPECT_EQ(series->series()->steps.size(), 2u);
    EXPECT_EQ(series->info().cells.has_value(), keeps);
  }
}

// Points that others than cells join, in one group of steps and in several.
TEST_F(KeptCells, AreLeftOutOfASeriesThatHasNone) {
  const auto build = [&](const char* name, BuildOptions options) {
    options.connectivity = Connectivity::none;
    ASSERT_EQ(message_of(build_series(steps(0, 3), path(name), options, silent)), "");
  };
  build("dropped.svol", {});
  for (const std::uint64_t memory : {std::uint64_t{1} << 20, std::uint64_t{1} << 30}) {
    build("kept.svol", {.memory = memory, .keep_cells = true});
    EXPECT_TRUE(read_text_file(path("kept.svol")).value() == read_text_file(path("dropped.svol")).value()) << memory;
  }
}

// Two bodies that touch, the first in two pieces. Their values agree at step 0, and later they jump. `second`: number
// of the other block.
double value_in(std::uint64_t block, std::size_t step, dvec3 p) {
  return step == 0 ? 3 : field(step, p) + (block == 1 ? 0 : 50);
}

std::vector<Piece> bodies_at(std::size_t step, std::uint64_t second = 2) {
  const Mesh left = lattice(6), right = lattice(6, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  std::vector<Piece> pieces = cut(mesh_piece(left, [&](dvec3 p) { return value_in(1, step, p); }), 2);
  pieces.push_back(mesh_piece(right, [&](dvec3 p) { return value_in(2, step, p); }));
  pieces[0].block = pieces[1].block = 1;
  pieces[2].block = second;
  return pieces;
}

std::vector<SeriesStep> body_steps(std::size_t begin, std::size_t end, std::uint64_t second = 2) {
  std::vector<SeriesStep> list;
  for (std::size_t step = begin; step < end; ++step)
    list.push_back(step_of(fmt::format("step {}", step), static_cast<double>(step), bodies_at(step, second)));
  return list;
}

constexpr std::uint64_t body_points = 7 * 7 * 7, seam_points = 7 * 7;

// Expects that each cell of the file has the values of its own block.
void expect_own_values(const format::Volume& volume, std::size_t step) {
  const auto cells = value_of(CellReader::open(volume));
  format::RankedPoints points(*cells, own_room(1 << 20));
  std::size_t right = 0, all = 0;
  for (const format::CellChunk& chunk : chunks_of(*cells)) {
    std::vector<format::RankedPoints::Place> places;
    std::vector<dvec3> corners;
    std::vector<float> values;
    ASSERT_TRUE(points.find(chunk.corners, places));
    ASSERT_TRUE(points.read_positions(places, corners));
    ASSERT_TRUE(points.read_values(places, 0, values));
    for (std::size_t first = 0; first < corners.size(); first += 4) {
      double x = 0;
      for (std::size_t k = first; k < first + 4; ++k) x += corners[k].x / 4;
      right += x > 1 ? 1 : 0;
      ++all;
      for (std::size_t k = first; k < first + 4; ++k)
        ASSERT_NEAR(volume.info().attributes[0].value(double{values[k]}), value_in(x > 1 ? 2 : 1, step, corners[k]),
                    0.05)
            << corners[k].x;
    }
  }
  EXPECT_EQ(all, 2u * 6 * 6 * 6 * 6);
  EXPECT_EQ(2 * right, all);
}

TEST_F(KeptCells, OfTwoBlocksKeepTheirOwnValuesWhereTheyTouch) {
  const BuildOptions options{.keep_cells = true}, little{.memory = 1 << 20, .keep_cells = true};
  const auto built = value_of(build_series(body_steps(0, 4), path("series.svol"), options, silent));
  EXPECT_EQ(built.build.points.unlike, 0u);
  for (const std::size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    ASSERT_EQ(message_of(build_series(body_steps(0, 4), path("apart.svol"), little, silent)), "");
    EXPECT_TRUE(read_text_file(path("series.svol")).value() == read_text_file(path("apart.svol")).value());
  }
  // Blocks may have other numbers, as long as they are the same blocks.
  ASSERT_EQ(message_of(build_series(body_steps(0, 1), path("grown.svol"), options, silent)), "");
  ASSERT_EQ(message_of(append_to_series(body_steps(1, 4, 77), path("grown.svol"), {}, silent)), "");
  for (const char* name : {"series.svol", "grown.svol"}) {
    const auto series = open_checked(path(name));
    EXPECT_EQ(series->info().point_count(), 2 * body_points);
    EXPECT_TRUE(series->info().cells->blocks_apart);
    for (std::size_t step = 0; step < 4; ++step) expect_own_values(*value_of(series->at_step(step)), step);
  }
}

TEST_F(KeptCells, OfOneBlockAreJoinedAcrossItsPieces) {
  const BuildOptions options{.keep_cells = true};
  for (const bool keeps : {false, true}) {
    const std::uint64_t second = keeps ? 1 : 2;  // without cells, blocks are joined too
    const auto built =
        value_of(build_series(body_steps(0, 2, second), path("series.svol"), {.keep_cells = keeps}, silent));
    EXPECT_EQ(built.build.points.unlike, seam_points);
    const auto series = open_checked(path("series.svol"));
    EXPECT_EQ(series->info().point_count(), 2 * body_points - seam_points);
    EXPECT_EQ(series->info().cells.has_value(), keeps);
  }
}

// The rule of the file, also of files of before there was a choice.
TEST_F(KeptCells, AnAppendFollowsTheFilesRuleForBlocks) {
  const BuildOptions options{.keep_cells = true};
  ASSERT_EQ(message_of(build_series(body_steps(0, 1, 1), path("joined.svol"), options, silent)), "");
  EXPECT_THAT(message_of(append_to_series(body_steps(1, 2), path("joined.svol"), {}, silent)),
              HasSubstr("its cells are not those of the steps before"));

  const std::string text = read_text_file(path("joined.svol")).value();
  const auto change = [&](const std::string& from, const std::string& to) {
    const auto change_metadata = [&](Part part, std::size_t index, format::Bytes& bytes) {
      if (part != Part::metadata || index > 0) return;
      std::string json = text_of(bytes);
      const std::size_t at = json.find(from);
      ASSERT_NE(at, std::string::npos);
      bytes = bytes_of(json.replace(at, from.size(), to));
    };
    const Dissected file(bytes_of(text));
    return text_of(file.assemble(change_metadata, Packing::as_before));
  };
  write("older.svol", change(R"("copies":"block",)", ""));
  EXPECT_FALSE(open_checked(path("older.svol"))->info().cells->blocks_apart);
  ASSERT_EQ(message_of(append_to_series(body_steps(1, 2), path("older.svol"), options, silent)), "");
  const auto older = open_checked(path("older.svol"));
  EXPECT_FALSE(older->info().cells->blocks_apart);
  EXPECT_EQ(older->series()->steps.size(), 2u);

  write("newer.svol", change(R"("copies":"block")", R"("copies":"other")"));
  EXPECT_THAT(message_of(format::Volume::open(*open_file(path("newer.svol")))), HasSubstr("'other' is unknown"));
}

TEST_F(KeptCells, BlocksDoNotChangeFromStepToStep) {
  std::vector<SeriesStep> list = body_steps(0, 1);
  list.push_back(body_steps(1, 2, 1)[0]);
  EXPECT_THAT(message_of(build_series(list, path("series.svol"), {.keep_cells = true}, silent)),
              HasSubstr("its blocks are others"));
}

}  // namespace
}  // namespace splatvol::test
