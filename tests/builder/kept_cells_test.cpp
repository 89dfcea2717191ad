// Cells of their own, whole cells and cells of a series, as files keep them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using format::CellField;
using format::CellReader;
using format::CellShape;
using testing::HasSubstr;

const auto silent = [](const char*, double) {};

class KeptCells : public test::FolderTest {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(path(name)) << text; }

  [[nodiscard]] std::shared_ptr<const format::Volume> open_checked(const std::string& name) const {
    auto volume = test::value_of(format::Volume::open(*open_file(path(name))));
    EXPECT_EQ(test::message_of(volume->verify([](double) {}, 2)), "") << name;
    return volume;
  }

  std::shared_ptr<const format::Volume> build(const std::string& input, const SourceOptions& source_options,
                                              bool exact = true) const {
    const auto source = test::value_of(open_source({path(input)}, source_options));
    BuildOptions options{.keep_cells = true};
    options.exact = {.positions = exact, .values = exact};
    report_ = test::value_of(build_volume(*source, path("out.svol"), options, silent));
    return open_checked("out.svol");
  }

  mutable BuildReport report_;
};

// All chunks of a file.
std::vector<format::CellChunk> chunks_of(const CellReader& cells) {
  std::vector<format::CellChunk> chunks;
  for (std::size_t page = 0; page < cells.pages().size(); ++page)
    for (const format::CellChunkEntry& entry : test::value_of(cells.read_page(page, {})).chunks)
      chunks.push_back(test::value_of(cells.read_chunk(entry)));
  return chunks;
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
    const auto cells = test::value_of(CellReader::open(*volume));
    ASSERT_EQ(cells->kinds().size(), 1u);
    EXPECT_EQ(cells->kinds()[0].shape, CellShape::hexahedron);
    EXPECT_EQ(cells->kinds()[0].field, CellField::constant);
    EXPECT_EQ(cells->kinds()[0].cells, static_cast<std::uint64_t>(n * n * n));
    EXPECT_EQ(cells->vertex_count(), static_cast<std::uint64_t>((n + 1) * (n + 1) * (n + 1)));
    format::RankedPoints points(*cells, 1 << 20);
    format::CellVertices vertices([&](std::size_t page) { return cells->read_vertex_page(page); }, 1 << 20);
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
    if (exact) EXPECT_EQ(found.size(), static_cast<std::size_t>(n * n * n));
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
  const auto cells = test::value_of(CellReader::open(*volume));
  std::multiset<CellShape> kinds;
  for (const format::CellKind& kind : cells->kinds()) {
    EXPECT_EQ(kind.cells, 1u);
    EXPECT_EQ(kind.field, CellField::corners);
    kinds.insert(kind.shape);
  }
  EXPECT_EQ(kinds, (std::multiset<CellShape>{CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge,
                                             CellShape::hexahedron}));
  format::RankedPoints points(*cells, 1 << 20);
  const std::map<CellShape, double> volumes = {
      {CellShape::hexahedron, 1}, {CellShape::pyramid, 1.0 / 3}, {CellShape::wedge, 0.5}};
  for (const format::CellChunk& chunk : chunks_of(*cells)) {
    std::vector<format::RankedPoints::Place> places;
    std::vector<dvec3> corners;
    ASSERT_TRUE(points.find(chunk.corners, places));
    ASSERT_TRUE(points.read_positions(places, corners));
    double sum = 0;
    for (const auto& [a, b, c, d] : format::tetrahedra_of(chunk.shape, chunk.split_at(0)))
      sum += std::abs(glm::dot(corners[b] - corners[a], glm::cross(corners[c] - corners[a], corners[d] - corners[a])));
    if (const auto expected = volumes.find(chunk.shape); expected != volumes.end())
      EXPECT_NEAR(sum / 6, expected->second, 1e-12);
  }
  // The cells are the same if the nodes of a cell are listed in another order.
  const std::uint64_t hash = volume->info().cells->hash;
  std::string turned = shapes;
  turned.replace(turned.find("8 0 1 2 3 4 5 6 7"), 17, "8 1 2 3 0 5 6 7 4");
  write("turned.vtk", turned);
  EXPECT_EQ(build("turned.vtk", {})->info().cells->hash, hash);
  turned.replace(turned.find("4 0 1 15 16"), 11, "4 0 2 15 16");
  write("other.vtk", turned);
  EXPECT_NE(build("other.vtk", {})->info().cells->hash, hash);
}

double field(std::size_t step, dvec3 p) { return static_cast<double>(step + 1) * (p.x + 2 * p.y) + p.z; }

std::vector<Piece> pieces_of(std::size_t step) {
  const test::Mesh mesh = test::lattice(8, [](dvec3 p) { return dvec3(p.x * p.x, p.y, 0.3 * p.z); });
  return test::cut(test::mesh_piece(mesh, [&](dvec3 p) { return field(step, p); }), 3);
}

std::vector<SeriesStep> steps(std::size_t begin, std::size_t end) {
  std::vector<SeriesStep> list;
  for (std::size_t step = begin; step < end; ++step)
    list.push_back(test::step_of(fmt::format("step {}", step), static_cast<double>(step), pieces_of(step)));
  return list;
}

// What a file tells of its chunks, with the ranges of the present step.
std::vector<std::string> summaries_of(const format::Volume& volume) {
  const auto cells = test::value_of(CellReader::open(volume));
  std::vector<std::string> lines;
  for (std::size_t page = 0; page < cells->pages().size(); ++page) {
    const auto read = test::value_of(cells->read_page(page, {0, -1}));
    for (std::size_t chunk = 0; chunk < read.chunks.size(); ++chunk)
      lines.push_back(fmt::format("{} {:016x} {} {} {:016x}", read.chunks[chunk].cells, read.chunks[chunk].hash,
                                  read.summaries[chunk].min, read.summaries[chunk].max,
                                  read.summaries[chunk].occupancy));
  }
  return lines;
}

TEST_F(KeptCells, OfASeriesAreThoseOfEachStep) {
  const BuildOptions options{.keep_cells = true}, little{.memory = 1 << 20, .keep_cells = true};
  ASSERT_EQ(test::message_of(build_series(steps(0, 4), path("series.svol"), options, silent)), "");
  ASSERT_EQ(test::message_of(build_series(steps(0, 4), path("apart.svol"), little, silent)), "");
  EXPECT_TRUE(read_text_file(path("series.svol")).value() == read_text_file(path("apart.svol")).value());
  ASSERT_EQ(test::message_of(build_series(steps(0, 2), path("grown.svol"), options, silent)), "");
  ASSERT_EQ(test::message_of(append_to_series(steps(2, 4), path("grown.svol"), {}, silent)), "");
  const auto series = open_checked("series.svol"), grown = open_checked("grown.svol");
  for (std::size_t step = 0; step < 4; ++step) {
    test::PieceSource source(pieces_of(step));
    ASSERT_EQ(test::message_of(build_volume(source, path("single.svol"), options, silent)), "");
    const auto single = open_checked("single.svol");
    EXPECT_EQ(series->info().cells->hash, single->info().cells->hash);
    EXPECT_EQ(summaries_of(*test::value_of(series->at_step(step))), summaries_of(*single)) << step;
    EXPECT_EQ(summaries_of(*test::value_of(grown->at_step(step))), summaries_of(*single)) << step;
  }
}

// The same points, and a cell less.
TEST_F(KeptCells, OfASeriesDoNotChange) {
  const BuildOptions options{.keep_cells = true};
  ASSERT_EQ(test::message_of(build_series(steps(0, 1), path("series.svol"), options, silent)), "");
  std::vector<Piece> pieces = pieces_of(1);
  pieces[0].tetrahedra.pop_back();
  const auto refused = append_to_series({test::step_of("step 1", 1, pieces)}, path("series.svol"), {}, silent);
  ASSERT_FALSE(refused);
  EXPECT_EQ(open_checked("series.svol")->series()->steps.size(), 1u);
  ASSERT_EQ(test::message_of(build_series(steps(0, 1), path("plain.svol"), {}, silent)), "");
  EXPECT_THAT(test::message_of(append_to_series(steps(1, 2), path("plain.svol"), options, silent)),
              HasSubstr("it keeps no cells"));
}

}  // namespace
}  // namespace splatvol
