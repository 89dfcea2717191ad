#include "splatvol/renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "splatvol/build.h"
#include "tests/library/lattice.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

float largest_alpha(const Image& image) {
  float alpha = 0;
  for (const vec4& pixel : image.pixels) alpha = std::max(alpha, pixel.a);
  return alpha;
}

struct DrawFile : ::testing::Test {
  DrawFile() { EXPECT_EQ(message_of(build(Lattice(20).mesh(), path_)), ""); }
  [[nodiscard]] Renderer open(const std::optional<Scene>& scene = std::nullopt) const {
    return Renderer::open(path_, scene).value();
  }

  TempFolder folder_;
  std::string path_ = folder_.path("lattice.svol");
};

TEST_F(DrawFile, DrawsASceneThatFits) {
  Renderer renderer = open();
  EXPECT_EQ(renderer.scene().attribute, "v");
  EXPECT_THAT(renderer.device(), testing::HasSubstr("processor")) << "also beside a graphics card";
  const Image image = renderer.render().value();
  EXPECT_EQ(image.width, renderer.scene().width);
  EXPECT_GT(largest_alpha(image), 0.1F);
  EXPECT_TRUE(renderer.statistics().is_complete);
  EXPECT_EQ(renderer.statistics().splats, 0) << "the cells are drawn";
  EXPECT_GT(renderer.statistics().bytes_read, 0);
  EXPECT_GT(renderer.statistics().requests, 0);
  ASSERT_TRUE(renderer.render({.tolerance_percent = 0}));
  EXPECT_EQ(renderer.statistics().splats, 9261);
}

TEST_F(DrawFile, TwoRenderersOfOneFileDrawTheSame) {
  Renderer a = open(), b = open(a.scene());
  EXPECT_EQ(a.render()->pixels, b.render()->pixels);
}

TEST_F(DrawFile, KeepsToItsQuality) {
  Renderer renderer = open();
  const Image exact = renderer.render().value();
  ASSERT_TRUE(renderer.render({.max_splats = 3000}));
  EXPECT_LE(renderer.statistics().splats, 3000);
  ASSERT_TRUE(renderer.render({.resolution = 0}));
  const std::uint64_t coarsest = renderer.statistics().splats;
  ASSERT_TRUE(renderer.render({.tolerance_percent = 20}));
  EXPECT_LT(renderer.statistics().splats, 9261);
  EXPECT_GE(renderer.statistics().splats, coarsest);
  ASSERT_TRUE(renderer.render({.max_error = 0.02}));
  EXPECT_LE(renderer.statistics().error, 0.025);
  EXPECT_THAT(renderer.render({.max_error = 0.02, .max_splats = 5}).error().message, HasSubstr("give one of"));
  EXPECT_THAT(renderer.render({.max_error = -1}).error().message, HasSubstr("above 0"));
  EXPECT_THAT(renderer.render({.max_splats = 0}).error().message, HasSubstr("0 splats"));
  EXPECT_EQ(renderer.render()->pixels, exact.pixels);
}

TEST_F(DrawFile, DrawsContoursExactly) {
  Renderer renderer = open();
  Scene scene = renderer.scene();
  scene.transfer_function.densities = {{0, 0}};
  scene.contours = {{.values = {0.5 * (scene.transfer_function.lo + scene.transfer_function.hi)}}};
  ASSERT_TRUE(renderer.set_scene(scene));
  const Image image = renderer.render().value();
  EXPECT_EQ(largest_alpha(image), 1);
  EXPECT_EQ(renderer.render({.exact = true})->pixels, image.pixels);
  EXPECT_EQ(largest_alpha(renderer.render({.milliseconds = 1000}).value()), 1);
  EXPECT_GT(largest_alpha(renderer.render({.tolerance_percent = 0}).value()), 0.5) << "shells stand for them";
}

TEST_F(DrawFile, RefusesExactPicturesWithoutCells) {
  ASSERT_TRUE(build(Lattice(20).mesh(), path_, {.keep_cells = false}));
  Renderer renderer = open();
  EXPECT_THAT(renderer.render({.exact = true}).error().message, HasSubstr("without --drop-cells"));
  EXPECT_THAT(renderer.render({.max_error = 0.02, .exact = true}).error().message, HasSubstr("give one of"));
  EXPECT_THAT(renderer.render_now(0, {.exact = true}).error().message, HasSubstr("no frames on the way"));
  EXPECT_TRUE(renderer.render());
  EXPECT_EQ(renderer.statistics().splats, 9261);
}

TEST_F(DrawFile, SettlesWhileItLoads) {
  std::atomic<int> wakes = 0;
  Renderer renderer = Renderer::open(path_, std::nullopt, {.device = Device::cpu, .on_data = [&] { ++wakes; }}).value();
  int frames = 0;
  do {
    ASSERT_TRUE(renderer.render_now(0.01));
  } while (!renderer.statistics().is_settled && ++frames < 1000);
  EXPECT_TRUE(renderer.statistics().is_complete);
  EXPECT_EQ(renderer.statistics().splats, 9261);
  EXPECT_TRUE(renderer.render({.milliseconds = 50}));
}

// Until the next minor version.
TEST_F(DrawFile, OldNamesStillDraw) {
  Renderer renderer = open();
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
  EXPECT_TRUE(renderer.render_within(0.05));
  EXPECT_FALSE(renderer.render_within(0));
#pragma GCC diagnostic pop
  EXPECT_THAT(renderer.render_now(0, {.milliseconds = 5}).error().message, HasSubstr("no frames on the way"));
}

TEST_F(DrawFile, ChangesSceneAndSize) {
  Renderer renderer = open();
  Scene scene = renderer.fitting_scene("v", 64, 32).value();
  ASSERT_TRUE(renderer.set_scene(scene));
  EXPECT_EQ(renderer.render()->pixels.size(), 64 * 32);
  scene.attribute = "w";
  EXPECT_THAT(renderer.set_scene(scene).error().message, HasSubstr("no attribute \"w\""));
  EXPECT_EQ(renderer.scene().attribute, "v");
  EXPECT_TRUE(renderer.render());
  EXPECT_FALSE(renderer.show_step(1));
}

TEST_F(DrawFile, SurfacesHideWhatIsBehind) {
  Renderer renderer = open();
  const Scene& scene = renderer.scene();
  const auto pixels = static_cast<std::size_t>(scene.width) * static_cast<std::size_t>(scene.height);
  const Image all = renderer.render().value();
  ASSERT_TRUE(
      renderer.set_surface_depths(SurfaceDepths{scene.width, scene.height, std::vector<float>(pixels, 0.001F)}));
  EXPECT_EQ(largest_alpha(*renderer.render()), 0);
  ASSERT_TRUE(renderer.set_surface_depths(SurfaceDepths{3, 2, std::vector<float>(6, 0.001F)}));
  for (const Quality& quality : {Quality{.exact = true}, Quality{.max_splats = 100}, Quality{}})
    EXPECT_THAT(message_of(renderer.render(quality)), HasSubstr("for 3 x 2 pixels, but the picture has"));
  ASSERT_TRUE(renderer.set_surface_depths(std::nullopt));
  EXPECT_EQ(renderer.render()->pixels, all.pixels);
}

TEST_F(DrawFile, ScenesThatShowSurfacesAreRefused) {
  Renderer renderer = open();
  Scene scene = renderer.scene();
  scene.surfaces = {{.file = "a.stl"}};
  EXPECT_THAT(renderer.set_scene(scene),
              FailsWith(ErrorCode::unsupported, HasSubstr("a.stl is read by the programs svrender")));
  EXPECT_TRUE(renderer.scene().surfaces.empty());
  scene.surfaces[0].shown = false;
  EXPECT_TRUE(renderer.set_scene(scene));
}

TEST_F(DrawFile, ScenesThatShowAPatchNeedABoundary) {
  Renderer renderer = open();
  Scene scene = renderer.scene();
  scene.surfaces = {{.boundary = "outer"}};
  EXPECT_THAT(renderer.set_scene(scene).error().message, HasSubstr("holds no boundary, and so no patch \"outer\""));
}

// The cells have one of many corners near each corner of another cell: most rays that meet one of them meet all.
TEST_F(DrawFile, AfterAPictureThatNeedsTooMuchTheNextOneIsDrawn) {
  constexpr std::int64_t count = 24;
  std::vector<double> points, values;
  for (int corner = 0; corner < 4; ++corner)
    for (int i = 0; i < count; ++i)
      for (int axis = 0; axis < 3; ++axis) points.push_back((axis == corner ? 1 : 0) + 0.1 * std::sin(i * (axis + 2)));
  for (std::size_t i = 0; i < points.size(); i += 3) values.push_back(points[i] + points[i + 1]);
  std::vector<std::int64_t> connectivity, offsets = {0};
  for (std::int64_t cell = 0; cell < count * count * count * count; ++cell) {
    for (std::int64_t corner = 0, rest = cell; corner < 4; ++corner, rest /= count)
      connectivity.push_back(corner * count + rest % count);
    offsets.push_back(4 * (cell + 1));
  }
  const std::vector<std::uint8_t> types(offsets.size() - 1, 10);
  const std::string path = folder_.path("heap.svol");
  ASSERT_EQ(message_of(build({.points = std::span<const double>(points),
                              .connectivity = connectivity,
                              .offsets = offsets,
                              .types = types,
                              .point_values = {{.name = "v", .values = std::span<const double>(values)}}},
                             path)),
            "");
  Renderer renderer = Renderer::open(path, std::nullopt, {.memory = 4 << 20}).value();
  Scene scene = renderer.fitting_scene("", 1, 1).value();
  ASSERT_TRUE(renderer.set_scene(scene));
  EXPECT_THAT(renderer.render({.exact = true}),
              FailsWith(ErrorCode::out_of_budget, testing::MatchesRegex("[^\n]*heap.svol: [^\n]*memory[^\n]*")));
  EXPECT_GT(largest_alpha(renderer.render({.tolerance_percent = 0}).value()), 0);
  scene.clip_box = Box{{2, 2, 2}, {3, 3, 3}};
  ASSERT_TRUE(renderer.set_scene(scene));
  EXPECT_EQ(largest_alpha(renderer.render({.exact = true}).value()), 0) << "the box has no cells";
}

TEST_F(DrawFile, CallsComeFromAnyThread) {
  Renderer renderer = open();
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back([&] { EXPECT_TRUE(renderer.render({.max_splats = 300})); });
  for (std::thread& thread : threads) thread.join();
  renderer.cancel();
  EXPECT_TRUE(renderer.render());
}

TEST_F(DrawFile, ErrorsNameTheFile) {
  EXPECT_THAT(Renderer::open(folder_.path("none.svol")).error().message, HasSubstr("none.svol"));
}

}  // namespace
}  // namespace splatvol::test
