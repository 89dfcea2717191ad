// Cells and contours in memory. Those in files are the same: tests/tools/export.
#include "extractor/cell_extraction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "base/file.h"
#include "base/interruption.h"
#include "extractor/contour_extraction.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/builder/support/mesh_of_shapes.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr double none = std::numeric_limits<double>::quiet_NaN();
const BuildOptions exact = {.exact = {.positions = true, .values = true}, .keep_cells = true};

struct Extraction : FolderTest {
  void build_shapes(CellValues cells) {
    const std::string input = write("shapes.vtk", mesh_of_shapes());
    build_input(input, path("a.svol"), exact,
                {.selection = {cells == CellValues::own ? "number" : "value"}, .cells = cells});
    open();
  }
  void open() { volume_ = value_of(format::Volume::open(value_of(open_file(path("a.svol"))))); }
  format::SplatSelection select(const Box& box = format::SplatSelection().box) const {
    return value_of(format::select_splats(*volume_, std::nullopt, {}, box));
  }

  std::shared_ptr<const format::Volume> volume_;
};

TEST_F(Extraction, CellsKeepTheirShapes) {
  build_shapes(CellValues::averaged);
  const CellMesh mesh = value_of(extract_cells(*volume_, select()));
  std::map<int, int> types;
  for (const std::uint8_t type : mesh.types) ++types[type];
  EXPECT_EQ(types[12], 1);
  EXPECT_EQ(types[13], 1);
  EXPECT_EQ(types[14], 1);
  EXPECT_GT(types[10], 1) << "the tetrahedron, and those of the polyhedron";
  ASSERT_THAT(mesh.offsets, SizeIs(mesh.types.size() + 1));
  EXPECT_EQ(mesh.offsets.back(), static_cast<std::int64_t>(mesh.connectivity.size()));
  for (std::size_t cell = 0; cell < mesh.types.size(); ++cell)
    EXPECT_EQ(mesh.offsets[cell + 1] - mesh.offsets[cell], mesh.types[cell] == 12   ? 8
                                                           : mesh.types[cell] == 13 ? 6
                                                           : mesh.types[cell] == 14 ? 5
                                                                                    : 4);
  EXPECT_THAT(mesh.cell_values, SizeIs(0));
  ASSERT_THAT(mesh.point_values, SizeIs(1));
  ASSERT_THAT(mesh.point_values[0].numbers, SizeIs(mesh.points.size()));
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const dvec3& p = mesh.points[i];
    EXPECT_EQ(mesh.point_values[0].numbers[i], p.x + 2 * p.y + 4 * p.z);
  }
}

TEST_F(Extraction, CellsOfTheirOwnHaveValues) {
  build_shapes(CellValues::own);
  const CellMesh mesh = value_of(extract_cells(*volume_, select()));
  EXPECT_THAT(mesh.point_values, SizeIs(0));
  ASSERT_THAT(mesh.cell_values, SizeIs(1));
  ASSERT_THAT(mesh.cell_values[0].numbers, SizeIs(mesh.types.size()));
  const std::map<int, double> numbers = {{12, 0}, {14, 1}, {13, 2}};
  for (std::size_t cell = 0; cell < mesh.types.size(); ++cell)
    if (const auto number = numbers.find(mesh.types[cell]); number != numbers.end()) {
      EXPECT_EQ(mesh.cell_values[0].numbers[cell], number->second);
    }
}

TEST_F(Extraction, DoesNotDependOnThreadsAndTakesWhatMeetsABox) {
  build_input("gen:mesh:cells=5e4,pieces=8", path("a.svol"), exact);
  open();
  const format::SplatSelection selection = select({dvec3(-1, -1, -1), dvec3(1.5, 1, 1)});
  // Numbers as they are written, in their order.
  struct Record final : CellOutput {
    Status write_corners(std::uint64_t first, std::span<const std::uint64_t> corners) override {
      mesh.connectivity.resize(std::max<std::size_t>(mesh.connectivity.size(), first + corners.size()));
      std::ranges::copy(corners, mesh.connectivity.begin() + static_cast<std::ptrdiff_t>(first));
      return {};
    }
    Status read_corners(std::uint64_t first, std::span<std::uint64_t> corners) override {
      std::ranges::copy(std::span(mesh.connectivity).subspan(first, corners.size()), corners.begin());
      return {};
    }
    Status append_sources(std::span<const std::uint64_t> /*points*/) override { return {}; }
    Status read_sources(std::uint64_t /*first*/, std::span<std::uint64_t> /*points*/) override { return {}; }
    Status set_counts(const CellCounts& /*counts*/) override { return {}; }
    Status write_points(std::uint64_t /*first*/, std::span<const dvec3> points) override {
      mesh.points.insert(mesh.points.end(), points.begin(), points.end());
      return {};
    }
    Status write_values(std::size_t /*array*/, std::uint64_t /*first*/, std::span<const double> /*values*/) override {
      return {};
    }
    Status write_kinds(std::uint64_t /*first*/, std::span<const std::uint64_t> /*ends*/,
                       std::span<const std::uint8_t> types) override {
      mesh.types.insert(mesh.types.end(), types.begin(), types.end());
      return {};
    }
    CellMesh mesh;
  };
  const auto extraction = value_of(CellExtraction::open(*volume_, selection));
  const CellMesh expected = value_of(extract_cells(*volume_, selection));
  for (const std::size_t threads : {1u, 5u}) {
    Record record;
    const CellExtractionReport report = value_of(extraction.write(
        record, [](double) {}, threads));
    EXPECT_EQ(report.counts.cells, expected.types.size());
    EXPECT_TRUE(record.mesh.points == expected.points && record.mesh.connectivity == expected.connectivity) << threads;
    EXPECT_TRUE(record.mesh.types == expected.types);
  }
  EXPECT_LT(expected.types.size(), value_of(extract_cells(*volume_, select())).types.size());
  EXPECT_THAT(message_of(extract_cells(*volume_, select({dvec3(50), dvec3(51)}))), HasSubstr("no cells in the box"));
}

TEST_F(Extraction, VectorsAreArraysOfThreeComponents) {
  const Mesh mesh = jittered(6, 0.2);
  Piece piece = mesh_piece(mesh, [](dvec3 p) { return p.x; });
  for (int axis = 0; axis < 3; ++axis)
    piece.values.push_back(test::sample(mesh, [&](dvec3 p) { return p.z > 0.8 && axis == 1 ? none : p[axis]; }));
  PieceSource source({piece}, {.attributes = {"value", "U[0]", "U[1]", "U[2]"}});
  ASSERT_TRUE(build_volume(source, path("a.svol"), exact, [](const char*, double) {}));
  open();
  const auto expect_positions = [](const MeshValues& array, const std::vector<dvec3>& points) {
    EXPECT_EQ(array.name, "U");
    ASSERT_EQ(array.components, 3);
    ASSERT_THAT(array.numbers, SizeIs(3 * points.size()));
    for (std::size_t i = 0; i < points.size(); ++i)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double number = array.numbers[3 * i + axis];
        if (axis != 1 || points[i].z < 0.6) {
          EXPECT_NEAR(number, points[i][static_cast<int>(axis)], 1e-6) << i;
        } else if (points[i].z > 0.99) {
          EXPECT_TRUE(std::isnan(number)) << i;
        }
      }
  };
  const CellMesh cells = value_of(extract_cells(*volume_, select()));
  ASSERT_THAT(cells.point_values, SizeIs(2));
  EXPECT_THAT(cells.points, SizeIs(mesh.points.size()));
  expect_positions(cells.point_values[1], cells.points);
  const ContourMesh contour = value_of(extract_contour(*volume_, select(), 0.4));
  ASSERT_THAT(contour.point_values, SizeIs(2));
  EXPECT_GT(contour.triangles.size(), 50);
  for (const double value : contour.point_values[0].numbers) EXPECT_EQ(value, 0.4);
  for (const dvec3& point : contour.points) EXPECT_NEAR(point.x, 0.4, 1e-6);
  expect_positions(contour.point_values[1], contour.points);
}

TEST_F(Extraction, HeedsAnInterruption) {
  build_shapes(CellValues::averaged);
  std::stop_source stop;
  stop.request_stop();
  const format::SplatSelection selection = select();
  const Interruptible heeds(stop.get_token());
  EXPECT_EQ(extract_cells(*volume_, selection).error().code, ErrorCode::cancelled);
  EXPECT_EQ(extract_contour(*volume_, selection, 2.1).error().code, ErrorCode::cancelled);
}

}  // namespace
}  // namespace splatvol::test
