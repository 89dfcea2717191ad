#include "splatvol/file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <span>
#include <vector>

#include "splatvol/build.h"
#include "tests/library/lattice.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

struct OpenFile : ::testing::Test {
  OpenFile() { EXPECT_EQ(message_of(build(lattice_.mesh(), path_, {.exact = true})), ""); }
  [[nodiscard]] File open() const { return File::open(path_).value(); }

  TempFolder folder_;
  std::string path_ = folder_.path("lattice.svol");
  Lattice lattice_{12};
};

TEST_F(OpenFile, TellsWhatItHolds) {
  const File file = open();
  EXPECT_EQ(file.name(), path_);
  EXPECT_EQ(file.point_count(), 13 * 13 * 13);
  ASSERT_EQ(file.attributes().size(), 1);
  EXPECT_EQ(file.attributes()[0].name, "v");
  EXPECT_EQ(file.attributes()[0].unit, "m/s");
  EXPECT_EQ(file.attributes()[0].low, 0);
  EXPECT_EQ(file.attributes()[0].high, 6);
  EXPECT_TRUE(file.times().empty());
  EXPECT_EQ(file.bounds().low, dvec3(0));
  EXPECT_EQ(file.bounds().high, dvec3(1));
  EXPECT_TRUE(file.verify());
}

TEST_F(OpenFile, GivesThePointsOfTheInput) {
  const Points points = open().points().value();
  ASSERT_EQ(points.positions.size(), 13 * 13 * 13);
  for (std::size_t i = 0; i < points.positions.size(); ++i) {
    const dvec3& p = points.positions[i];
    EXPECT_EQ(points.values[0][i], static_cast<float>(Lattice::field(p.x, p.y, p.z)));
  }
}

TEST_F(OpenFile, EveryResolutionHasAllMaterial) {
  const File file = open();
  for (std::size_t r = 0; r < file.resolution_counts().size(); ++r) {
    const Points points = file.points({.resolution = r, .material = true}).value();
    EXPECT_EQ(points.resolution, r);
    EXPECT_EQ(points.positions.size(), file.resolution_counts()[r]);
    EXPECT_NEAR(std::accumulate(points.volumes.begin(), points.volumes.end(), 0.0), 1, 2e-3);
  }
}

TEST_F(OpenFile, TakesTheFinestResolutionOfABudget) {
  const File file = open();
  const auto& counts = file.resolution_counts();
  ASSERT_GE(counts.size(), 2);
  EXPECT_EQ(file.points({.max_points = counts[1] - 1}).value().positions.size(), counts[0]);
  EXPECT_EQ(file.points({.max_points = counts[1]}).value().positions.size(), counts[1]);
  EXPECT_EQ(file.points({.max_points = 0}).value().resolution, 0);
}

TEST_F(OpenFile, LeavesOutWhatIsOutsideOfABox) {
  const Points points = open().points({.box = Box{dvec3(0), dvec3(0.5)}}).value();
  EXPECT_EQ(points.positions.size(), 7 * 7 * 7);
}

TEST_F(OpenFile, SamplesALinearField) {
  std::vector<dvec3> inside, outside;
  for (int i = 0; i < 1000; ++i)
    inside.emplace_back(0.02 + 0.96 * std::fmod(i * 0.618, 1), 0.02 + 0.96 * std::fmod(i * 0.414, 1),
                        0.02 + 0.96 * std::fmod(i * 0.732, 1));
  outside = {dvec3(1.2), dvec3(-0.2, 0.5, 0.5), dvec3(NAN), dvec3(1e300)};
  const File file = open();
  const std::vector<double> of_cells = file.sample(inside, "v").value();
  const std::vector<double> of_splats = file.sample(inside, "v", file.resolution_counts().size() - 1).value();
  for (std::size_t i = 0; i < inside.size(); ++i) {
    const double expected = Lattice::field(inside[i].x, inside[i].y, inside[i].z);
    EXPECT_NEAR(of_cells[i], expected, 1e-6) << i;
    EXPECT_NEAR(of_splats[i], expected, 0.02) << i;
  }
  const std::vector<double> nothing = file.sample(outside, "v").value();
  for (const double value : nothing) EXPECT_TRUE(std::isnan(value));
  EXPECT_TRUE(file.sample({}, "v").value().empty());
}

TEST_F(OpenFile, FollowsALine) {
  const File file = open();
  const dvec3 start(-0.5, 0.4, 0.3), end(1.5, 0.6, 0.7);
  const LineSamples rows = file.sample_line(start, end).value();
  EXPECT_EQ(rows.names, std::vector<std::string>{"v"});
  double inside = 0;
  for (std::size_t row = 1; row < rows.arc_lengths.size(); ++row) {
    const dvec3& p = rows.positions[row];
    if (std::isnan(rows.values[0][row])) continue;
    EXPECT_NEAR(rows.values[0][row], Lattice::field(p.x, p.y, p.z), 1e-6);
    inside += rows.arc_lengths[row] - rows.arc_lengths[row - 1];
  }
  EXPECT_NEAR(inside, glm::length(end - start) / 2, 1e-9);
  const LineSamples even = file.sample_line(start, end, {"v"}, 5).value();
  ASSERT_EQ(even.values[0].size(), 5);
  EXPECT_TRUE(std::isnan(even.values[0][0]) && std::isnan(even.values[0][4]));
  EXPECT_NEAR(even.values[0][2], Lattice::field(0.5, 0.5, 0.5), 1e-6);
  EXPECT_THAT(file.sample_line(start, start).error().message, HasSubstr("no length"));
  EXPECT_THAT(file.sample_line(start, end, {}, 1).error().message, HasSubstr("two samples"));
  EXPECT_THAT(file.sample_line(start, end, {"w"}).error().message, HasSubstr("no attribute \"w\""));
  ASSERT_TRUE(build(lattice_.mesh(), path_, {.keep_cells = false}));
  EXPECT_THAT(open().sample_line(start, end).error().message, HasSubstr("keeps no cells"));
}

TEST_F(OpenFile, GivesTheCellsOfTheMesh) {
  const CellMesh mesh = open().cells().value();
  EXPECT_EQ(mesh.points.size(), 13 * 13 * 13);
  ASSERT_EQ(mesh.point_values.size(), 1);
  EXPECT_EQ(mesh.point_values[0].unit, "m/s");
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const dvec3& p = mesh.points[i];
    EXPECT_EQ(mesh.point_values[0].numbers[i], static_cast<float>(Lattice::field(p.x, p.y, p.z)));
  }
  // A mesh of the library again.
  std::vector<double> positions;
  for (const dvec3& p : mesh.points) positions.insert(positions.end(), {p.x, p.y, p.z});
  const MeshArrays arrays{.points = std::span<const double>(positions),
                          .connectivity = mesh.connectivity,
                          .offsets = mesh.offsets,
                          .types = mesh.types,
                          .point_values = {{"v", std::span<const double>(mesh.point_values[0].numbers)}}};
  EXPECT_EQ(message_of(build(arrays, folder_.path("again.svol"), {.exact = true})), "");
  const CellMesh again = File::open(folder_.path("again.svol")).value().cells().value();
  EXPECT_TRUE(again.points == mesh.points && again.connectivity == mesh.connectivity && again.types == mesh.types);
  EXPECT_THAT(message_of(open().cells({.box = Box{dvec3(7), dvec3(8)}})), HasSubstr("no cells in the box"));
}

TEST_F(OpenFile, GivesTheSurfaceOfAValue) {
  const ContourMesh contour = open().contour(2.5, "v").value();
  ASSERT_GT(contour.triangles.size(), 100);
  for (const dvec3& p : contour.points) EXPECT_NEAR(Lattice::field(p.x, p.y, p.z), 2.5, 1e-6);
  for (const double value : contour.point_values.at(0).numbers) EXPECT_EQ(value, 2.5);
  EXPECT_THAT(message_of(open().contour(7, "v")), HasSubstr("nowhere 7"));
  EXPECT_THAT(message_of(open().contour(1, "q")), HasSubstr("attribute"));
  EXPECT_THAT(message_of(open().contour(std::nan(""), "v")), HasSubstr("no value of a contour"));
}

TEST_F(OpenFile, IntegratesOverTheCells) {
  const Integrals all = open().integrate().value();
  ASSERT_EQ(all.attributes.size(), 1);
  EXPECT_EQ(all.attributes[0].unit, "m/s");
  const auto [low, high] = open().bounds();
  EXPECT_NEAR(all.volume, (high.x - low.x) * (high.y - low.y) * (high.z - low.z), 1e-12);
  EXPECT_EQ(all.attributes[0].low, open().attributes()[0].low);
  const dvec3 middle = 0.5 * (low + high);
  const Integrals half = open().integrate({.clip_planes = {{middle, {0, 0, -2}}}}).value();
  EXPECT_NEAR(half.volume, all.volume / 2, 1e-12);
  const Integrals above = open().integrate({.ranges = {{.attribute = "v", .low = 2.5}}}).value();
  const Integrals below = open().integrate({.ranges = {{.attribute = "v", .high = 2.5}}}).value();
  EXPECT_EQ(above.attributes[0].low, 2.5);
  EXPECT_NEAR(above.volume + below.volume, all.volume, 1e-12);
  EXPECT_NEAR(above.attributes[0].integral + below.attributes[0].integral, all.attributes[0].integral, 1e-12);
  EXPECT_THAT(message_of(open().integrate({.attributes = {"w"}})), HasSubstr("no attribute \"w\""));
}

TEST_F(OpenFile, FollowsStreamlines) {
  MeshArrays mesh = lattice_.mesh();
  std::vector<double> vectors;
  for (std::size_t i = 0; i < lattice_.values.size(); ++i) vectors.insert(vectors.end(), {0, 2, 0});
  mesh.point_values.push_back({.name = "U", .values = std::span<const double>(vectors), .components = 3});
  ASSERT_EQ(message_of(build(mesh, path_, {.exact = true})), "");
  const Streamlines found =
      open()
          .streamlines({.vector = "U", .seeds = SeedLine{dvec3(0.5), {0.5, 0.5, 2}, 2}, .attributes = {"v", "U"}})
          .value();
  EXPECT_EQ(found.names, (std::vector<std::string>{"v", "U"}));
  ASSERT_EQ(found.lines.size(), 2);
  const Streamline& line = found.lines[0];
  EXPECT_EQ(name_of(line.begin), "mesh");
  EXPECT_NEAR(line.positions.front().y, 0, 1e-9);
  EXPECT_NEAR(line.times.front(), -0.25, 1e-9);
  EXPECT_NEAR(line.times.back(), 0.25, 1e-9);
  EXPECT_NEAR(line.values[0].back(), Lattice::field(0.5, 1, 0.5), 1e-6);
  EXPECT_EQ(line.values[1].back(), 2);
  EXPECT_TRUE(found.lines[1].positions.empty());
  EXPECT_THAT(message_of(open().streamlines({.vector = "v", .seeds = SeedLine{dvec3(0), dvec3(1)}})),
              HasSubstr("vectors: U"));
}

TEST_F(OpenFile, TellsWhatIsNotThere) {
  const File file = open();
  EXPECT_THAT(file.points({.resolution = 99}).error().message, HasSubstr("no resolution 99"));
  EXPECT_THAT(file.points({.attributes = {"w"}}).error().message, HasSubstr("no attribute \"w\"; there are: v"));
  EXPECT_THAT(file.sample({}, "w").error().message, HasSubstr("no attribute \"w\""));
  EXPECT_EQ(File::open(folder_.path("none.svol")).error().code, ErrorCode::io);
  folder_.write("text.svol", "not a volume");
  EXPECT_EQ(File::open(folder_.path("text.svol")).error().code, ErrorCode::invalid_data);
}

}  // namespace
}  // namespace splatvol::test
