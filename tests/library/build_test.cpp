#include "splatvol/build.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <list>
#include <numeric>

#include "splatvol/file.h"
#include "tests/library/lattice.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

struct BuildArrays : ::testing::Test {
  // What building says of arrays that are damaged.
  std::string error_of(const MeshArrays& mesh, const MeshBuildOptions& options = {}) {
    const auto built = build(mesh, folder_.path("out.svol"), options);
    EXPECT_TRUE(folder_.names().empty());
    return built ? "built" : built.error().message;
  }

  TempFolder folder_;
  std::string path_ = folder_.path("a.svol");
  Lattice lattice_{8};
};

TEST_F(BuildArrays, TellsWhatWasBuilt) {
  std::vector<std::string> stages;
  MeshBuildOptions options;
  options.progress = [&](const char* stage, double) { stages.emplace_back(stage); };
  const MeshBuildReport report = build(lattice_.mesh(), path_, options).value();
  EXPECT_EQ(report.resolution_counts.back(), 729);
  EXPECT_EQ(report.connectivity, "mesh");
  EXPECT_EQ(report.file_bytes, folder_.read("a.svol").size());
  EXPECT_EQ(report.kept_cells, 8 * 8 * 8 * 6);
  EXPECT_FALSE(report.census.empty());
  EXPECT_FALSE(stages.empty());
}

TEST_F(BuildArrays, LeavesCellsOutIfAsked) {
  const MeshBuildReport kept = build(lattice_.mesh(), path_).value();
  const MeshBuildReport dropped = build(lattice_.mesh(), path_, {.keep_cells = false}).value();
  EXPECT_EQ(dropped.kept_cells, 0);
  EXPECT_LT(dropped.file_bytes, kept.file_bytes);
}

TEST_F(BuildArrays, SinglePrecisionIsReadWhereItLies) {
  const std::vector<float> points(lattice_.points.begin(), lattice_.points.end());
  const std::vector<float> values(lattice_.values.begin(), lattice_.values.end());
  MeshArrays mesh = lattice_.mesh();
  mesh.points = std::span<const float>(points);
  mesh.point_values[0].values = std::span<const float>(values);
  ASSERT_TRUE(build(mesh, path_, {.exact = true}));
  ASSERT_TRUE(build(lattice_.mesh(), folder_.path("b.svol"), {.exact = true}));
  EXPECT_EQ(folder_.read("a.svol"), folder_.read("b.svol"));  // eighths are exact
}

TEST_F(BuildArrays, PointsWithoutCells) {
  MeshArrays mesh = lattice_.mesh();
  mesh.connectivity = mesh.offsets = {};
  mesh.types = {};
  const MeshBuildReport report = build(mesh, path_).value();
  EXPECT_EQ(report.connectivity, "delaunay");
  EXPECT_GT(report.kept_cells, 5 * 8 * 8 * 8 - 1);
  EXPECT_EQ(File::open(path_)->point_count(), 729);
  EXPECT_EQ(build(mesh, path_, {.connectivity = "none"})->kept_cells, 0);
}

TEST_F(BuildArrays, VectorsHaveMagnitudeAndComponents) {
  std::vector<double> vectors;
  for (std::size_t i = 0; i < lattice_.values.size(); ++i) vectors.insert(vectors.end(), {3, 4, 12});
  MeshArrays mesh = lattice_.mesh();
  mesh.point_values = {{.name = "U", .values = std::span<const double>(vectors), .components = 3}};
  ASSERT_TRUE(build(mesh, path_));
  const File file = File::open(path_).value();
  std::vector<std::string> names;
  for (const Attribute& attribute : file.attributes()) names.push_back(attribute.name);
  EXPECT_THAT(names, testing::ElementsAre("U", "U[0]", "U[1]", "U[2]"));
  EXPECT_EQ(file.attributes()[0].high, 13);
}

TEST_F(BuildArrays, ValuesOfCells) {
  std::vector<double> of_cells(lattice_.types.size(), 5);
  of_cells[3] = NAN;
  MeshArrays mesh = lattice_.mesh();
  mesh.point_values.clear();
  mesh.cell_values = {{.name = "c", .values = std::span<const double>(of_cells)}};
  const MeshBuildReport averaged = build(mesh, path_).value();
  EXPECT_THAT(averaged.conversions, testing::ElementsAre("c: of cells, averaged to points"));
  EXPECT_EQ(File::open(path_)->attributes()[0].low, 5);
  const MeshBuildReport own = build(mesh, path_, {.own_cells = true}).value();
  EXPECT_EQ(own.resolution_counts.back(), 6 * 512);
  EXPECT_EQ(File::open(path_)->attributes()[0].missing, 1);
}

// A cube as a hexahedron and as a polyhedron is the same material.
TEST_F(BuildArrays, PolyhedraAreCells) {
  const std::vector<double> points = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1};
  const std::vector<double> values = {0, 1, 2, 3, 4, 5, 6, 7};
  const std::vector<std::int64_t> connectivity = {0, 1, 2, 3, 4, 5, 6, 7}, offsets = {0, 8}, locations = {0};
  const std::vector<std::int64_t> faces = {6, 4, 0, 3, 2, 1, 4, 4, 5, 6, 7, 4, 0, 1, 5, 4,
                                           4, 1, 2, 6, 5, 4, 2, 3, 7, 6, 4, 3, 0, 4, 7};
  MeshArrays mesh{.points = std::span<const double>(points), .connectivity = connectivity, .offsets = offsets};
  mesh.point_values = {{.name = "v", .values = std::span<const double>(values)}};
  const std::vector<std::uint8_t> hexahedron = {12}, polyhedron = {42};
  const auto volume = [&] {
    const Points material = File::open(path_)->points({.material = true}).value();
    return std::accumulate(material.volumes.begin(), material.volumes.end(), 0.0);
  };
  mesh.types = hexahedron;
  ASSERT_TRUE(build(mesh, path_));
  EXPECT_NEAR(volume(), 1, 3e-3);
  mesh.types = polyhedron;
  EXPECT_FALSE(build(mesh, path_));  // without faces
  mesh.faces = faces;
  mesh.face_locations = locations;
  ASSERT_TRUE(build(mesh, path_));
  EXPECT_NEAR(volume(), 1, 3e-3);
  mesh.faces = std::span(faces).first(20);
  EXPECT_THAT(build(mesh, path_).error().message, HasSubstr("faces of polyhedron 0"));
}

TEST_F(BuildArrays, DamagedArraysAreRefused) {
  MeshArrays mesh = lattice_.mesh();
  mesh.points = std::span<const double>(lattice_.points).first(10);
  EXPECT_THAT(error_of(mesh), HasSubstr("10 coordinates are no points of 3"));

  mesh = lattice_.mesh();
  std::vector<std::int64_t> numbers = lattice_.connectivity;
  for (const std::int64_t wrong : {std::int64_t{-1}, std::int64_t{729}, std::int64_t{1} << 40}) {
    numbers[17] = wrong;
    mesh.connectivity = numbers;
    EXPECT_THAT(error_of(mesh), HasSubstr("cell 4 names point"));
  }

  mesh = lattice_.mesh();
  mesh.offsets = mesh.offsets.first(10);
  EXPECT_THAT(error_of(mesh), HasSubstr("10 offsets for 3072 cells"));
  numbers = lattice_.offsets;
  numbers[5] = 1000000;
  mesh.offsets = numbers;
  EXPECT_THAT(error_of(mesh), HasSubstr("offsets of the cells do not rise"));
  numbers = lattice_.offsets;
  numbers[5] -= 1;
  EXPECT_THAT(error_of(mesh), HasSubstr("a tetrahedron of"));

  mesh = lattice_.mesh();
  std::vector<std::uint8_t> types = lattice_.types;
  types[7] = 72;
  mesh.types = types;
  EXPECT_THAT(error_of(mesh), HasSubstr("Lagrange hexahedron"));
  types[7] = 200;
  EXPECT_THAT(error_of(mesh), HasSubstr("VTK type 200"));

  mesh = lattice_.mesh();
  mesh.point_values[0].values = std::span<const double>(lattice_.values).first(5);
  EXPECT_THAT(error_of(mesh), HasSubstr("\"v\" has 5 numbers for 729 points"));
  mesh.point_values[0] = {.name = "", .values = std::span<const double>(lattice_.values)};
  EXPECT_THAT(error_of(mesh), HasSubstr("has no name"));
  mesh.point_values.clear();
  EXPECT_THAT(error_of(mesh), HasSubstr("no values"));
  EXPECT_THAT(error_of({}), HasSubstr("no points"));
}

TEST_F(BuildArrays, OptionsAreChecked) {
  EXPECT_THAT(error_of(lattice_.mesh(), {.connectivity = "voronoi"}), HasSubstr("take auto, mesh, delaunay"));
  EXPECT_THAT(error_of(lattice_.mesh(), {.reduction = "random"}), HasSubstr("take octree"));
  EXPECT_THAT(error_of(lattice_.mesh(), {.up = 'w'}), HasSubstr("take x, y or z"));
  EXPECT_THAT(build(lattice_.mesh(), folder_.path("a.vtu")).error().message, HasSubstr("must end in .svol"));
  EXPECT_THAT(build(lattice_.mesh(), folder_.path("none/a.svol")).error().message, HasSubstr("none/a.svol"));
}

// A time series of the lattice.
struct BuildSeries : BuildArrays {
  // Steps whose values are those of the lattice, and the time more.
  std::vector<MeshStep> steps(const std::vector<double>& times) {
    std::vector<MeshStep> result;
    for (const double time : times) {
      std::vector<double>& values = values_.emplace_back(lattice_.values);
      for (double& value : values) value += time;
      result.push_back({time, {{.name = "v", .values = std::span<const double>(values), .unit = "m/s"}}});
    }
    return result;
  }

  [[nodiscard]] MeshArrays mesh() const {
    MeshArrays mesh = lattice_.mesh();
    mesh.point_values.clear();
    return mesh;
  }

  std::list<std::vector<double>> values_;  // they stay where they are
};

TEST_F(BuildSeries, HoldsTheValuesOfAllSteps) {
  ASSERT_TRUE(build_series(mesh(), steps({1, 2}), path_, {.exact = true}));
  const auto report = value_of(append_to_series(mesh(), steps({4}), path_));
  EXPECT_EQ(report.file_bytes, folder_.read("a.svol").size());
  File file = File::open(path_).value();
  EXPECT_THAT(file.times(), testing::ElementsAre(1, 2, 4));
  EXPECT_EQ(file.step(), 2);
  EXPECT_EQ(file.range_of("v"), std::pair(1.0, 10.0));  // the field: 0 to 6
  EXPECT_TRUE(std::isnan(file.range_of("w").first));
  EXPECT_EQ(file.attributes()[0].unit, "m/s");
  for (std::size_t step = 0; step < 3; ++step) {
    ASSERT_TRUE(file.show_step(step));
    const Points points = file.points().value();
    ASSERT_EQ(points.positions.size(), 729);
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
      const dvec3& p = points.positions[i];
      EXPECT_EQ(points.values[0][i], Lattice::field(p.x, p.y, p.z) + file.times()[step]);
    }
  }
  EXPECT_TRUE(file.verify());
}

TEST_F(BuildSeries, TellsTheNearestStep) {
  ASSERT_TRUE(build_series(mesh(), steps({1, 2, 4}), path_));
  const File file = File::open(path_).value();
  EXPECT_EQ(file.nearest_step(-7), 0);
  EXPECT_EQ(file.nearest_step(1.5), 0);  // as near to both: the earlier
  EXPECT_EQ(file.nearest_step(3.1), 2);
  EXPECT_EQ(file.nearest_step(1e300), 2);
  ASSERT_TRUE(build(lattice_.mesh(), path_));
  EXPECT_EQ(File::open(path_)->nearest_step(3), 0);
}

TEST_F(BuildSeries, RefusesStepsThatDoNotFit) {
  const auto error_of_steps = [&](const MeshArrays& mesh, const std::vector<MeshStep>& list) {
    const auto built = build_series(mesh, list, path_);
    EXPECT_TRUE(folder_.names().empty());
    return built ? "built" : built.error().message;
  };
  EXPECT_THAT(error_of_steps(mesh(), {}), HasSubstr("no step"));
  EXPECT_THAT(error_of_steps(mesh(), steps({1, 1})), HasSubstr("times of steps rise"));
  EXPECT_THAT(error_of_steps(mesh(), steps({NAN})), HasSubstr("times of steps rise"));
  EXPECT_THAT(error_of_steps(lattice_.mesh(), steps({1})), HasSubstr("belong to its steps"));
  std::vector<MeshStep> list = steps({1, 2});
  list[1].point_values[0].name = "w";
  EXPECT_THAT(error_of_steps(mesh(), list), HasSubstr("arrays at 2: its attributes are not those of arrays at 1"));
  list[1].point_values.clear();
  EXPECT_THAT(error_of_steps(mesh(), list), HasSubstr("arrays at 2"));
}

TEST_F(BuildSeries, AppendingLeavesTheFileIfItFails) {
  ASSERT_TRUE(build_series(mesh(), steps({1, 2}), path_));
  const std::string before = folder_.read("a.svol");
  EXPECT_FALSE(append_to_series(mesh(), steps({2}), path_));
  Lattice other(7);
  std::swap(other.points, lattice_.points);
  EXPECT_FALSE(append_to_series(mesh(), steps({3}), path_));
  EXPECT_EQ(folder_.read("a.svol"), before);
  std::swap(other.points, lattice_.points);
  ASSERT_TRUE(build(lattice_.mesh(), path_));
  EXPECT_THAT(message_of(append_to_series(mesh(), steps({3}), path_)), HasSubstr("not a time series"));
}

}  // namespace
}  // namespace splatvol::test
