// From file to picture along a camera's path: changes of resolution do not show as jumps.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "renderer/device/device.h"
#include "streamer/streamer.h"
#include "tests/builder/support/built_input.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

constexpr std::uint64_t plenty = 256u << 20;
constexpr double long_enough = 60;  // seconds; only a failing test waits this long

struct Path {
  double largest = 0, mean = 0;  // RMSE from frame to frame
  std::uint64_t fading = 0;
};

// Draws frames of a camera that moves towards a volume and round it. Each frame waits for all of its chunks. Half way,
// the tolerance becomes coarser.
Path fly(const std::string& file, Detail detail, double change) {
  constexpr int frames = 40;
  const TransferFunction function{-1, 1, {{0, dvec3(1, 0, 0)}, {1, dvec3(0, 0.5, 1)}}, {{0, 0.2}, {1, 2}}};
  const auto streamer = Streamer::open(open_file(file).value(), {plenty, "value", KernelKind::moments}).value();
  const auto renderer = make_rasterizer(Device::cpu, {.kernel = KernelKind::moments}).value();
  EXPECT_TRUE(renderer->set_transfer_function(function, streamer->units()));
  Path path;
  Image last;
  for (int i = 0; i < frames; ++i) {
    Camera camera;
    const double angle = 0.0005 * i, distance = 8 - 0.005 * i;
    camera.position = distance * dvec3(std::sin(angle), 0.2, std::cos(angle));
    const View view = make_view(camera, 96, 96).value();
    if (i == frames / 2) detail.tolerance_percent *= 3;
    const FrameSplats& frame = *streamer->advance(view, function, detail, long_enough, change).value();
    EXPECT_EQ(frame.progress.missing_rows, 0u);
    EXPECT_TRUE(renderer->set_draw_list(frame.list));
    EXPECT_TRUE(renderer->draw(view, SortMode::exact, 1));
    Image image = renderer->read_image().value();
    if (i > 0) {
      const double jump = compare_images(last, image).value().rmse;
      path.largest = std::max(path.largest, jump);
      path.mean += jump / (frames - 1);
    }
    path.fading += frame.progress.fading;
    last = std::move(image);
  }
  return path;
}

// The bound is the one of docs/decisions/2026-11-21-fading.md.
TEST(Fade, StepsAreThoseOfAFixedResolution) {
  const TempFolder folder;
  const std::string file = folder.path("m.svol");
  build_input("gen:mesh:cells=4e4,pieces=1", file);

  const Path fixed = fly(file, {.resolution = 99}, 1);
  const Path at_once = fly(file, {.tolerance_percent = 5, .resolution = std::nullopt}, 1);
  const Path faded = fly(file, {.tolerance_percent = 5, .resolution = std::nullopt}, 1.0 / 8);
  EXPECT_GT(at_once.largest, 1.5 * fixed.largest) << "there is nothing to see on this path";
  EXPECT_LE(faded.largest, 1.5 * fixed.largest);
  EXPECT_LE(faded.mean, 1.5 * fixed.mean);
  EXPECT_GT(faded.fading, 8u);
}

}  // namespace
}  // namespace splatvol::test
