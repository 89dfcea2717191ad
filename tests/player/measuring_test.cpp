// What a window measures: when, and of what.
#include "player/measuring.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/file.h"
#include "sampler/vector_field.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t memory = std::uint64_t{16} << 20;

// "value" is the distance from the middle, "U[i]" the positions.
class MeasuringTest : public FolderTest {
 protected:
  void SetUp() override {
    const Mesh mesh = lattice(12);
    Piece piece = mesh_piece(mesh, [](dvec3 p) { return glm::distance(p, dvec3(0.5)); });
    std::vector<std::string> names = {"value", "U[0]", "U[1]", "U[2]", "V[0]", "V[1]"};
    for (std::size_t i = 1; i < names.size(); ++i)
      piece.values.push_back(mesh_piece(mesh, [&](dvec3 p) { return p[static_cast<int>(i + 2) % 3]; }).values[0]);
    PieceSource source({piece}, {.attributes = names});
    require(build_volume(source, path("mesh.svol"), {.keep_cells = true}, [](const char*, double) {}));
    steps_.emplace(value_of(format::Steps::open(path("mesh.svol"), open_file)));
    scene_.attribute = "value";
    scene_.transfer_function.colors = {{0, dvec3(1)}};
    scene_.contours = {{.values = {0.3, 0.4}}};
  }

  Status update(double seconds, bool is_held = false) {
    return measures_.update(host_, *steps_, 0, scene_, memory, seconds, is_held);
  }

  InlineHost host_;
  std::optional<format::Steps> steps_;
  Scene scene_;
  ContourMeasures measures_;
};

TEST_F(MeasuringTest, ContoursHaveAreaAndVolumeAfterAPause) {
  ASSERT_TRUE(update(1));
  EXPECT_TRUE(measures_.is_busy());
  ASSERT_TRUE(update(0.1));
  EXPECT_FALSE(measures_.size_of(0.3)) << "too soon";
  ASSERT_TRUE(update(0.3));  // the first is measured
  ASSERT_TRUE(update(0.01));
  ASSERT_TRUE(measures_.size_of(0.3));
  EXPECT_NEAR(measures_.size_of(0.3)->area, 4 * std::numbers::pi * 0.09, 0.05);
  EXPECT_NEAR(measures_.size_of(0.3)->volume, -4.0 / 3 * std::numbers::pi * 0.027, 0.01) << "a hole";
  ASSERT_TRUE(update(0.01));
  EXPECT_TRUE(measures_.size_of(0.4));
  EXPECT_FALSE(measures_.is_busy());
}

TEST_F(MeasuringTest, NothingIsMeasuredWhileAValueIsHeld) {
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(update(0.2, true));
  EXPECT_FALSE(measures_.size_of(0.3));
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(update(0.2));
  EXPECT_TRUE(measures_.size_of(0.3));
  scene_.contours[0].values[0] = 0.31;
  ASSERT_TRUE(update(0.2));
  EXPECT_FALSE(measures_.size_of(0.31)) << "that of another value";
  EXPECT_FALSE(measures_.size_of(0.3));
  EXPECT_TRUE(measures_.size_of(0.4));
}

TEST_F(MeasuringTest, AFailureIsToldOnce) {
  scene_.attribute = "heat";
  ASSERT_TRUE(update(0));
  ASSERT_TRUE(update(1));
  EXPECT_THAT(message_of(update(1)), HasSubstr("heat"));
  EXPECT_THAT(message_of(update(1)), HasSubstr("heat")) << "of the other value";
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(update(1));
  EXPECT_FALSE(measures_.is_busy());
  scene_.attribute = "value";
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(update(1));
  EXPECT_TRUE(measures_.size_of(0.3));
}

TEST_F(MeasuringTest, RequestsAreCellsContoursAndSlices) {
  scene_.clip_box = Box{dvec3(0), {0.5, 1, 1}};
  scene_.clip_planes = {{{0, 0, 0.25}, {0, 0, 1}, true}, {{0, 0, 0}, {0, 0, -1}, false}};
  const IntegralRequest region = region_of(scene_);
  EXPECT_EQ(region.box, scene_.clip_box);
  ASSERT_EQ(region.clip_planes.size(), 1u);
  Measuring measuring;
  const auto measured = [&](const MeasureRequest& request) {
    measuring.begin(host_, *steps_, request, memory);
    return value_of(*measuring.take());
  };
  EXPECT_NEAR(std::get<Integrals>(measured({.integrals = region})).volume, 0.375, 1e-6);
  EXPECT_EQ(measuring.share(), 1);
  EXPECT_FALSE(measuring.take());
  const auto slice = std::get<SurfaceIntegrals>(measured(
      {.surface = HalfSpace{{0.4, 0, 0}, {1, 0, 0}}, .integrals = region, .vector = {"U[0]", "U[1]", "U[2]"}}));
  EXPECT_NEAR(slice.area, 0.75, 1e-6);
  EXPECT_NEAR(slice.flux, 0.3, 1e-4);
  const auto contour = std::get<SurfaceIntegrals>(measured({.surface = ContourSurface{"value", 0.4}}));
  EXPECT_LT(contour.enclosed_volume, 0);
  measuring.begin(host_, *steps_, {.integrals = {.attributes = {"heat"}}}, memory);
  EXPECT_THAT(message_of(*measuring.take()), HasSubstr("heat"));
}

TEST_F(MeasuringTest, VectorsHaveThreeComponents) {
  const auto volume = value_of(steps_->volume(0));
  EXPECT_EQ(vectors_of(volume->info()), std::vector<std::string>{"U"});
}

}  // namespace
}  // namespace splatvol::test
