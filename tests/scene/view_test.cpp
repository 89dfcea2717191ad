#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/scene.h"

namespace splatvol {
namespace {

Camera oblique_camera() { return {.position = {3, -2, 5}, .focal_point = {-1, 4, 2}, .up = {0.3, 7, 1}}; }

TEST(View, IsAnOrthonormalFrame) {
  const auto view = make_view(oblique_camera(), 64, 48);
  ASSERT_TRUE(view);
  EXPECT_NEAR(glm::length(view->right), 1, 1e-15);
  EXPECT_NEAR(glm::length(view->up), 1, 1e-15);
  EXPECT_NEAR(glm::length(view->forward), 1, 1e-15);
  EXPECT_NEAR(glm::length(glm::cross(view->right, view->up) + view->forward), 0, 1e-15);
  EXPECT_GT(glm::dot(view->up, oblique_camera().up), 0);
}

TEST(View, PutsTheFocalPointStraightAhead) {
  const auto view = make_view(oblique_camera(), 64, 48);
  ASSERT_TRUE(view);
  const dvec3 ahead = view->to_view(oblique_camera().focal_point);
  EXPECT_NEAR(ahead.x, 0, 1e-14);
  EXPECT_NEAR(ahead.y, 0, 1e-14);
  EXPECT_NEAR(ahead.z, std::sqrt(16.0 + 36 + 9), 1e-14);
}

TEST(View, HasTheWorldsHandedness) {
  Camera camera{.position = {0, 0, 5}};
  const auto view = make_view(camera, 10, 10);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->to_view({1, 2, 3}), dvec3(1, 2, 2));
}

TEST(View, FocalLengthIsInPixels) {
  Camera camera = oblique_camera();
  camera.vertical_fov_degrees = 90;
  auto view = make_view(camera, 64, 48);
  ASSERT_TRUE(view);
  EXPECT_NEAR(view->focal, 24, 1e-12);
  camera.projection = Camera::Projection::orthographic;
  camera.parallel_height = 12;
  view = make_view(camera, 64, 48);
  ASSERT_TRUE(view);
  EXPECT_NEAR(view->focal, 4, 1e-12);
}

TEST(View, RefusesADegenerateCamera) {
  const auto is_refused = [](const Camera& camera) { return !make_view(camera, 8, 8); };
  Camera camera = oblique_camera();
  EXPECT_FALSE(is_refused(camera));
  camera.focal_point = camera.position;
  EXPECT_TRUE(is_refused(camera));
  camera = oblique_camera();
  camera.up = {0, 0, 0};
  EXPECT_TRUE(is_refused(camera));
  camera.up = 3.0 * (camera.position - camera.focal_point);
  EXPECT_TRUE(is_refused(camera));
  camera = oblique_camera();
  camera.position.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(is_refused(camera));
  EXPECT_FALSE(make_view(oblique_camera(), 0, 8));
}

}  // namespace
}  // namespace splatvol
