#include "streamer/splats/frustum.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/streamer/fixture.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

// Whether the square round a disc touches the image. The disc is parallel to the image, in front of the eye.
bool square_touches(const View& view, const dvec3& point, double radius) {
  const dvec3 p = view.to_view(point);
  if (p.z <= 0) return false;
  const double scale = view.orthographic ? view.focal : view.focal / p.z;
  const double reach = std::max(radius * scale, 1.5);
  return std::abs(p.x) * scale < 0.5 * view.width + reach && std::abs(p.y) * scale < 0.5 * view.height + reach;
}

TEST(Frustum, NeverLosesAVisibleSplat) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  int left_out = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const View view = random_view(random);
    const Frustum frustum(view, 1.5);
    const Cube cube{{2 * uniform(random) - 0.5, 2 * uniform(random) - 0.5, 2 * uniform(random) - 0.5},
                    0.3 * uniform(random)};
    const double radius = 0.2 * uniform(random) * uniform(random);
    if (frustum.touches(cube, radius)) continue;
    ++left_out;
    for (int sample = 0; sample < 50; ++sample) {
      const dvec3 point = cube.origin + cube.edge * random_vector(uniform, random);
      ASSERT_FALSE(square_touches(view, point, radius)) << "trial " << trial;
    }
  }
  EXPECT_GT(left_out, 1000);
}

TEST(Frustum, LeavesOutWhatIsFarOutside) {
  Camera camera{.vertical_fov_degrees = 90, .position = {0, 0, 5}};
  const Frustum frustum(*make_view(camera, 100, 100), 1.5);
  EXPECT_TRUE(frustum.touches({{-0.5, -0.5, -0.5}, 1}, 0));
  EXPECT_TRUE(frustum.touches({{-0.5, -0.5, 4.5}, 1}, 0)) << "around the eye";
  EXPECT_FALSE(frustum.touches({{-0.5, -0.5, 5.5}, 1}, 0)) << "behind the eye";
  EXPECT_TRUE(frustum.touches({{-0.5, -0.5, 5.5}, 1}, 0.6)) << "behind the eye, but splats reach past it";
  EXPECT_FALSE(frustum.touches({{6, -0.5, -0.5}, 1}, 0)) << "to the right";
  EXPECT_TRUE(frustum.touches({{6, -0.5, -1000}, 1}, 0)) << "far away";
}

TEST(Frustum, NearestDepthIsThatOfTheNearestCorner) {
  Camera camera{.position = {0, 0, 5}};
  const Frustum straight(*make_view(camera, 100, 100), 1.5);
  EXPECT_DOUBLE_EQ(straight.nearest_depth({{-0.5, -0.5, -0.5}, 1}), 4.5);
  EXPECT_DOUBLE_EQ(straight.nearest_depth({{-0.5, -0.5, 4}, 2}), -1);
  camera.position = {3, 3, 3};
  const Frustum diagonal(*make_view(camera, 100, 100), 1.5);
  EXPECT_NEAR(diagonal.nearest_depth({{0, 0, 0}, 1}), 2 * std::sqrt(3.0), 1e-12);
}

TEST(Frustum, CoverageIsTheShareOfTheShorterSide) {
  Camera camera{.vertical_fov_degrees = 90, .position = {0, 0, 5}};
  const Frustum perspective(*make_view(camera, 400, 200), 1.5);
  EXPECT_NEAR(perspective.covered_percent(1, 10), 5, 1e-12) << "20 units are high where 10 are deep";
  EXPECT_TRUE(std::isinf(perspective.covered_percent(1, 0)));
  EXPECT_TRUE(std::isinf(perspective.covered_percent(1, -3)));
  const Frustum portrait(*make_view(camera, 100, 200), 1.5);
  EXPECT_NEAR(portrait.covered_percent(1, 10), 10, 1e-12);
  camera.projection = Camera::Projection::orthographic;
  camera.parallel_height = 4;
  const Frustum parallel(*make_view(camera, 400, 200), 1.5);
  EXPECT_NEAR(parallel.covered_percent(1, -100), 25, 1e-12);
}

}  // namespace
}  // namespace splatvol::test
