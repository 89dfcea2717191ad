// What the tests of both kernels share: views along -z, sums over pictures, and a rasterizer of each device.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <numeric>
#include <utility>

#include "pictures/image.h"
#include "renderer/device/device.h"
#include "tests/renderer/shared_context.h"

namespace splatvol::test {

/// The eye looks along -z, y up: a world point p has view coordinates (p.x, p.y, -p.z) from the eye.
inline View perspective_view(int width = 65, int height = 65, dvec3 eye = dvec3(0)) {
  Camera camera{.vertical_fov_degrees = 40, .position = eye, .focal_point = eye - dvec3(0, 0, 1)};
  return make_view(camera, width, height).value();
}

inline View orthographic_view(double world_height, int width = 65, int height = 65, dvec3 eye = dvec3(0)) {
  Camera camera{.projection = Camera::Projection::orthographic,
                .parallel_height = world_height,
                .position = eye,
                .focal_point = eye - dvec3(0, 0, 1)};
  return make_view(camera, width, height).value();
}

inline double total_alpha(const Image& image) {
  return std::accumulate(image.pixels.begin(), image.pixels.end(), 0.0,
                         [](double sum, const vec4& pixel) { return sum + pixel.a; });
}

/// Expects every channel finite, alpha at most 1, and no colour brighter than its alpha.
inline void expect_sane(const Image& image) {
  for (const vec4& pixel : image.pixels) {
    ASSERT_TRUE(pixel.a >= 0 && pixel.a <= 1) << pixel.a;
    for (int channel = 0; channel < 3; ++channel)
      ASSERT_TRUE(pixel[channel] >= 0 && pixel[channel] <= pixel.a + 1e-6F) << pixel[channel];
  }
}

inline double rmse(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

/// Draws by a device.
struct RasterizerTest : ::testing::TestWithParam<Device> {
  explicit RasterizerTest(KernelKind kernel) : kernel_(kernel) {}

  void SetUp() override {
    ASSERT_TRUE(shared_context());
    auto made = make_rasterizer(GetParam(), {.kernel = kernel_, .in_current_context = true});
    ASSERT_TRUE(made) << made.error().message;
    renderer_ = std::move(*made);
  }

  /// Draws the resident splats.
  Image redraw(const View& view, SortMode sort = SortMode::exact, int sample_spacing = 1) {
    const auto times = renderer_->draw(view, sort, sample_spacing);
    EXPECT_TRUE(times) << times.error().message;
    auto image = renderer_->read_image();
    EXPECT_TRUE(image) << image.error().message;
    return std::move(*image);
  }

  const KernelKind kernel_;
  std::unique_ptr<Rasterizer> renderer_;
};

}  // namespace splatvol::test
