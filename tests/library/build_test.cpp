#include "splatvol/build.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <numeric>

#include "splatvol/file.h"
#include "tests/library/lattice.h"

namespace splatvol {
namespace {

using ::testing::HasSubstr;

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class BuildArrays : public ::testing::Test {
 protected:
  // What building says of arrays that are damaged.
  std::string error_of(const MeshArrays& mesh, const MeshBuildOptions& options = {}) {
    const auto built = build(mesh, folder_.file("out.svol"), options);
    EXPECT_TRUE(folder_.is_empty());
    return built ? "built" : built.error().message;
  }

  test::Folder folder_;
  std::string path_ = folder_.file("a.svol");
  test::Lattice lattice_{8};
};

TEST_F(BuildArrays, TellsWhatWasBuilt) {
  std::vector<std::string> stages;
  MeshBuildOptions options;
  options.progress = [&](const char* stage, double) { stages.emplace_back(stage); };
  const MeshBuildReport report = build(lattice_.mesh(), path_, options).value();
  EXPECT_EQ(report.resolution_counts.back(), 729);
  EXPECT_EQ(report.connectivity, "mesh");
  EXPECT_EQ(report.file_bytes, bytes_of(path_).size());
  EXPECT_FALSE(report.census.empty());
  EXPECT_FALSE(stages.empty());
}

TEST_F(BuildArrays, MemoryChangesNoByte) {
  ASSERT_TRUE(build(lattice_.mesh(), path_, {.memory = 1 << 20}));
  ASSERT_TRUE(build(lattice_.mesh(), folder_.file("b.svol"), {.memory = 1 << 28}));
  EXPECT_EQ(bytes_of(path_), bytes_of(folder_.file("b.svol")));
}

TEST_F(BuildArrays, SinglePrecisionIsReadWhereItLies) {
  const std::vector<float> points(lattice_.points.begin(), lattice_.points.end());
  const std::vector<float> values(lattice_.values.begin(), lattice_.values.end());
  MeshArrays mesh = lattice_.mesh();
  mesh.points = std::span<const float>(points);
  mesh.point_values[0].values = std::span<const float>(values);
  ASSERT_TRUE(build(mesh, path_, {.exact = true}));
  ASSERT_TRUE(build(lattice_.mesh(), folder_.file("b.svol"), {.exact = true}));
  EXPECT_EQ(bytes_of(path_), bytes_of(folder_.file("b.svol")));  // eighths are exact
}

TEST_F(BuildArrays, PointsWithoutCells) {
  MeshArrays mesh = lattice_.mesh();
  mesh.connectivity = mesh.offsets = {};
  mesh.types = {};
  const MeshBuildReport report = build(mesh, path_).value();
  EXPECT_EQ(report.connectivity, "delaunay");
  EXPECT_EQ(File::open(path_)->point_count(), 729);
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
    const Points points = File::open(path_)->points({.material = true}).value();
    return std::accumulate(points.volumes.begin(), points.volumes.end(), 0.0);
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
  EXPECT_THAT(build(lattice_.mesh(), folder_.file("a.vtu")).error().message, HasSubstr("must end in .svol"));
  EXPECT_THAT(build(lattice_.mesh(), folder_.file("none/a.svol")).error().message, HasSubstr("none/a.svol"));
}

}  // namespace
}  // namespace splatvol
