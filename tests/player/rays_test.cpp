#include "player/rays.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/support/results.h"

namespace splatvol {
namespace {

TEST(Rays, GoThroughTheMiddlesOfPixels) {
  for (const auto& [width, height] : {std::array{512, 512}, {511, 300}, {2, 9000}, {9001, 1}, {64, 48}, {1921, 1080}}) {
    const auto label = ::testing::Message() << width << " x " << height;
    Camera camera;
    camera.position = {0, 0, 3};
    const View view = test::value_of(make_view(camera, width, height));
    const int spacing = spacing_of_rays(width, height);
    ASSERT_EQ(spacing % 2, 1) << label;
    const View of_rays = view_of_rays(view, spacing);
    EXPECT_GE(of_rays.width * of_rays.height, std::min(width * height, 4096)) << label;
    EXPECT_LE(of_rays.width * of_rays.height, std::max(4 * 8192, width + height)) << label;

    Image picture{width, height, {}};
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) picture.pixels.emplace_back(x, y, 0, 1);
    Rays rays{{of_rays.width, of_rays.height, {}}, spacing};
    rays.image.pixels.resize(static_cast<std::size_t>(of_rays.width * of_rays.height));
    const std::vector<vec3> places = at_rays(picture, rays);
    ASSERT_EQ(places.size(), rays.image.pixels.size()) << label;
    for (std::size_t i = 0; i < places.size(); ++i) {
      const int x = static_cast<int>(i) % of_rays.width, y = static_cast<int>(i) / of_rays.width;
      EXPECT_DOUBLE_EQ((x + 0.5 - 0.5 * of_rays.width) / of_rays.focal, (places[i].x + 0.5 - 0.5 * width) / view.focal);
      EXPECT_DOUBLE_EQ((y + 0.5 - 0.5 * of_rays.height) / of_rays.focal,
                       (places[i].y + 0.5 - 0.5 * height) / view.focal);
    }
  }
}

}  // namespace
}  // namespace splatvol
