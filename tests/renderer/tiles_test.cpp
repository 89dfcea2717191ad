// The tiles against OpenGL: on shared scenes and on random splats. And what only tiles have: threads, instruction sets.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>
#include <oneapi/tbb/global_control.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <map>

#include "base/interruption.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/gl/context.h"
#include "renderer/gl/gl_rasterizer.h"
#include "streamer/splats/streamer.h"
#include "tests/renderer/draw_parts.h"
#include "tests/renderer/random_splats.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

constexpr double bar = 1e-4;  // RMSE between the two ways

/// The same where each pixel sees few splats, of about two pixels, that are opaque: OpenGL rounds the corners of quads
/// to 1/256 of a pixel.
constexpr double bar_of_small_splats = 1e-3;

/// What is drawn, and how.
struct Drawing {
  DrawList list;
  DrawingUnits units;
  TransferFunction function;
  std::optional<Lighting> lighting;
  View view;
  SortMode sort = SortMode::exact;
  int sample_spacing = 1;
};

Image draw(Rasterizer& rasterizer, const Drawing& drawing) {
  rasterizer.set_lighting(drawing.lighting);
  EXPECT_TRUE(rasterizer.set_transfer_function(drawing.function, drawing.units));
  EXPECT_TRUE(rasterizer.set_draw_list(drawing.list));
  EXPECT_EQ(message_of(rasterizer.draw(drawing.view, drawing.sort, drawing.sample_spacing)), "");
  return rasterizer.read_image().value();
}

Image draw_by_tiles(const Drawing& drawing, KernelKind kernel = KernelKind::moments) {
  TileRasterizer tiles(kernel);
  return draw(tiles, drawing);
}

/// OpenGL's picture; the context lives as long as the program.
Image draw_by_gl(const Drawing& drawing, KernelKind kernel = KernelKind::moments) {
  static const auto context = HeadlessContext::create().value();
  return draw(*GlRasterizer::create(kernel).value(), drawing);
}

double difference(const Drawing& drawing, KernelKind kernel = KernelKind::moments) {
  const Image by_gl = draw_by_gl(drawing, kernel);
  const ImageDifference result = compare_images(by_gl, draw_by_tiles(drawing, kernel)).value();
  EXPECT_GT(result.mean_a, 1e-3) << "there is nothing to see";
  return result.rmse;
}

View view_of(bool orthographic, int width, int height, dvec3 eye = dvec3(0.3, 0.2, 4)) {
  Camera camera{.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective,
                .parallel_height = 2.2,
                .position = eye};
  return make_view(camera, width, height).value();
}

Drawing random_drawing(std::size_t count, double smallest, double largest, const View& view) {
  return {
      make_list(random_splats(count, smallest, largest), {{dvec3(0), 0, count}}), {}, lively(20), std::nullopt, view};
}

TEST(Tiles, RandomSplatsAgreeWithOpenGl) {
  for (const bool orthographic : {false, true})
    for (const auto& [smallest, largest] : {std::pair(0.002, 0.01), std::pair(0.01, 0.1), std::pair(1e-9, 1.0)}) {
      SCOPED_TRACE(testing::Message() << orthographic << " " << largest);
      EXPECT_LT(difference(random_drawing(5000, smallest, largest, view_of(orthographic, 131, 97))), bar);
    }
}

TEST(Tiles, TheEyeInsideAgreesWithOpenGl) {
  const Drawing drawing = random_drawing(3000, 0.01, 0.3, view_of(false, 131, 97, dvec3(0.1, 0.2, 0.3)));
  EXPECT_LT(difference(drawing), bar);
}

TEST(Tiles, LightSamplesAndOrdersAgreeWithOpenGl) {
  const Drawing plain = random_drawing(3000, 0.02, 0.1, view_of(false, 201, 150));
  Drawing drawing = plain;
  drawing.lighting = Lighting{0.2, 0.8};
  EXPECT_LT(difference(drawing), bar);
  for (const int spacing : {2, 5, max_sample_spacing}) {
    drawing = plain;
    drawing.sample_spacing = spacing;
    EXPECT_LT(difference(drawing), spacing < 64 ? bar : bar_of_small_splats) << spacing;
  }
  for (const SortMode sort : {SortMode::none, SortMode::axis})
    for (const double side : {-4.0, 4.0}) {
      drawing = plain;
      drawing.sort = sort;
      drawing.view = view_of(false, 120, 120, dvec3(side, 0.5, 1));
      EXPECT_LT(difference(drawing), bar) << side;
    }
}

TEST(Tiles, BentAxesAgreeWithOpenGl) {
  for (const ValueAxis axis : {ValueAxis::log, ValueAxis::asinh}) {
    Drawing drawing = random_drawing(3000, 0.02, 0.1, view_of(false, 120, 90));
    drawing.function.axis = axis;
    drawing.function.lo = 0.05;
    drawing.function.linear_width = 0.1;
    EXPECT_LT(difference(drawing), bar);
  }
}

TEST(Tiles, OctantsAgreeWithOpenGl) {
  std::vector<OctantSplat> splats;
  for (const MomentsSplat& m : random_splats(5000, 0.002, 0.3))
    splats.push_back({vec3(m.center), static_cast<float>(m.value), static_cast<float>(m.deviations.x), 0x00407f20});
  for (const bool orthographic : {false, true}) {
    Drawing drawing{make_list(splats, {{dvec3(0), 0, splats.size()}}),
                    {},
                    lively(2),
                    Lighting{0.2, 0.8},
                    view_of(orthographic, 131, 97)};
    EXPECT_LT(difference(drawing, KernelKind::octant), bar) << orthographic;
  }
}

TEST(Tiles, OddSizesAgreeWithOpenGl) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(33, 1), std::pair(31, 65), std::pair(3000, 7)})
    EXPECT_LT(difference(random_drawing(2000, 0.02, 0.2, view_of(false, width, height))), bar_of_small_splats) << width;
}

TEST(Tiles, FarFromTheOriginNothingChanges) {
  Drawing drawing = random_drawing(2000, 0.02, 0.1, view_of(false, 100, 100));
  const Image here = draw_by_tiles(drawing);
  const dvec3 far_away(1e9, -3e8, 1e8);
  const std::vector<MomentsSplat> splats = random_splats(2000, 0.02, 0.1);
  drawing.list = make_list(splats, {{far_away, 0, splats.size()}});
  drawing.view.eye += far_away;
  EXPECT_LT(compare_images(here, draw_by_tiles(drawing)).value().rmse, 1e-4);
}

TEST(Tiles, DrawTheSameBitsWithAnyNumberOfThreads) {
  const Drawing drawing = random_drawing(200'000, 0.002, 0.05, view_of(false, 300, 200));  // several batches
  std::optional<Image> first;
  for (const std::size_t threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Image image = draw_by_tiles(drawing);
    if (!first) first = image;
    EXPECT_EQ(std::memcmp(image.pixels.data(), first->pixels.data(), image.pixels.size() * sizeof(vec4)), 0) << threads;
  }
}

TEST(Tiles, DrawTheSamePictureWithAnyInstructions) {
  const Drawing drawing = random_drawing(20'000, 0.002, 0.2, view_of(false, 300, 200));
  const Image newest = draw_by_tiles(drawing);
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    const ImageDifference result = compare_images(newest, draw_by_tiles(drawing)).value();
    // Shorter vectors have shorter windows of the transfer table, and so take coarser levels of it.
    EXPECT_LT(result.rmse, bar) << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(Tiles, HoldFewBytesForASplat) {
  const Drawing drawing = random_drawing(1'000'000, 0.001, 0.003, view_of(false, 256, 256));
  TileRasterizer tiles(KernelKind::moments);
  static_cast<void>(draw(tiles, drawing));
  // The order takes 24 bytes of a splat; the rest does not grow with them.
  EXPECT_LT(tiles.device_bytes(), 24 * drawing.list.splats + (std::uint64_t{40} << 20));
}

// A picture that nobody waits for any more. The next one is whole.
TEST(Tiles, HeedInterruptions) {
  const Drawing drawing = random_drawing(200'000, 0.002, 0.05, view_of(false, 300, 200));  // several batches
  TileRasterizer tiles(KernelKind::moments);
  const Image whole = draw(tiles, drawing);
  for (const int spacing : {1, 2}) {
    std::stop_source stop;
    stop.request_stop();
    const Interruptible interruptible(stop.get_token());
    EXPECT_THAT(tiles.draw(drawing.view, drawing.sort, spacing), FailsWith(ErrorCode::cancelled));
  }
  EXPECT_EQ(compare_images(draw(tiles, drawing), whole)->max, 0);
}

TEST(Tiles, NothingGivesTransparentBlack) {
  Drawing drawing = random_drawing(10, 0.1, 0.2, view_of(false, 40, 30));
  drawing.list = {};
  for (const vec4& pixel : draw_by_tiles(drawing).pixels) EXPECT_EQ(pixel, vec4(0));
}

TEST(Tiles, RefuseWhatTheyCannotDraw) {
  const Drawing drawing = random_drawing(10, 0.1, 0.2, view_of(false, 40, 30));
  TileRasterizer tiles(KernelKind::moments);
  EXPECT_THAT(tiles.read_image().error().message, HasSubstr("no picture"));
  EXPECT_THAT(tiles.draw(drawing.view, SortMode::exact, 1).error().message, HasSubstr("transfer function"));
  ASSERT_TRUE(tiles.set_transfer_function(drawing.function, {}));
  View view = drawing.view;
  view.width = largest_tiled_side + 1;
  EXPECT_THAT(tiles.draw(view, SortMode::exact, 1).error().message, HasSubstr("16384"));
  EXPECT_THAT(tiles.draw(drawing.view, SortMode::exact, 0).error().message, HasSubstr("every 0 pixels"));
  DrawList list = drawing.list;
  list.ranges[0].count += 1'000'000;
  EXPECT_THAT(tiles.set_draw_list(list).error().message, HasSubstr("beyond"));
  TileRasterizer other(KernelKind::octant);
  EXPECT_THAT(other.set_draw_list(drawing.list).error().message, HasSubstr("other"));
}

/// The shared scenes, with all points of their meshes.
struct TilesTestScenes : testing::TestWithParam<const char*> {
  static constexpr const char* shared = SPLATVOL_SHARED;

  static std::string mesh_of(const std::string& scene) {
    return std::string(shared) + "/data/" + scene.substr(0, scene.find('-')) + ".vtu";
  }

  /// The file of a mesh, built once.
  static const std::string& file_of(const std::string& mesh) {
    static std::map<std::string, std::string> files;
    std::string& file = files[mesh];
    if (!file.empty()) return file;
    file = (std::filesystem::temp_directory_path() / fmt::format("splatvol_tiles_{}_{}.svol", ::getpid(), files.size()))
               .string();
    BuildOptions options{.gradients = true};
    EXPECT_TRUE(build_volume(*open_source({mesh}, {}).value(), file, options, [](const char*, double) {}));
    return file;
  }

  static void TearDownTestSuite() {
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::temp_directory_path()))
      if (entry.path().filename().string().starts_with(fmt::format("splatvol_tiles_{}_", ::getpid())))
        std::filesystem::remove(entry.path());
  }

  static Drawing drawing_of(const std::string& name, KernelKind kernel) {
    const Scene scene = load_scene(std::string(shared) + "/scenes/" + name + ".json").value();
    const auto streamer = Streamer::open(open_file(file_of(mesh_of(name))).value(),
                                         {.attribute = scene.attribute, .kernel = kernel, .gradients = true})
                              .value();
    const View view = make_view(scene).value();
    const FrameSplats& frame = *streamer->request(view, scene.transfer_function, {.tolerance_percent = 0}).value();
    return {frame.list, streamer->units(), scene.transfer_function, scene.lighting, view};
  }
};

TEST_P(TilesTestScenes, AgreeWithOpenGl) {
  if (!std::filesystem::exists(mesh_of(GetParam()))) GTEST_SKIP() << "no " << mesh_of(GetParam());
  Drawing drawing = drawing_of(GetParam(), KernelKind::moments);
  EXPECT_LT(difference(drawing), bar);
  drawing.lighting = Lighting{0.3, 0.7};
  drawing.sample_spacing = 3;
  EXPECT_LT(difference(drawing), bar) << "with light, and samples apart";
  EXPECT_LT(difference(drawing_of(GetParam(), KernelKind::octant), KernelKind::octant), bar) << "octant";
}

INSTANTIATE_TEST_SUITE_P(Shared, TilesTestScenes,
                         testing::Values("bluntfin", "bluntfin-ortho", "bluntfin-peak", "bluntfin-close", "post",
                                         "post-close", "wing", "wing-wake"));

}  // namespace
}  // namespace splatvol::test
