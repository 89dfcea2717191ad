#include "splatvol/file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "splatvol/build.h"
#include "tests/library/lattice.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using ::testing::HasSubstr;

class OpenFile : public ::testing::Test {
 protected:
  OpenFile() {
    MeshBuildOptions options;
    options.exact = true;
    const auto built = build(lattice_.mesh(), path_, options);
    EXPECT_TRUE(built) << built.error().message;
  }
  [[nodiscard]] File open() const { return File::open(path_).value(); }

  test::TempFolder folder_;
  std::string path_ = folder_.path("lattice.svol");
  test::Lattice lattice_{12};
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
  EXPECT_GE(file.bounds().extent().x, 1);
  EXPECT_TRUE(file.verify());
}

TEST_F(OpenFile, GivesThePointsOfTheInput) {
  const Points points = open().points().value();
  ASSERT_EQ(points.positions.size(), 13 * 13 * 13);
  for (std::size_t i = 0; i < points.positions.size(); ++i) {
    const dvec3& p = points.positions[i];
    EXPECT_EQ(points.values[0][i], static_cast<float>(test::Lattice::field(p.x, p.y, p.z)));
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
  const std::vector<double> values = file.sample(inside, "v").value();
  for (std::size_t i = 0; i < inside.size(); ++i)
    EXPECT_NEAR(values[i], test::Lattice::field(inside[i].x, inside[i].y, inside[i].z), 0.02) << i;
  const std::vector<double> nothing = file.sample(outside, "v").value();
  for (const double value : nothing) EXPECT_TRUE(std::isnan(value));
  EXPECT_TRUE(file.sample({}, "v").value().empty());
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
}  // namespace splatvol
