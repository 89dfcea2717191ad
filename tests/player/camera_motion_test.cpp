// Cameras that turn and come nearer.
#include "player/camera_motion.h"

#include <gtest/gtest.h>

#include "base/math.h"

namespace splatvol {
namespace {

Camera camera_before(const dvec3& focal_point) {
  Camera camera;
  camera.position = focal_point + dvec3(0, 0, 4);
  camera.focal_point = focal_point;
  camera.up = {0, 1, 0};
  return camera;
}

TEST(CameraMotion, AWholeTurnIsALoop) {
  const Camera first = camera_before({1, 2, 3});
  const CameraMotion turn{.frames = 4};
  EXPECT_EQ(camera_at(first, turn, 0), first);
  const dvec3 quarter = camera_at(first, turn, 1).position - first.focal_point;
  EXPECT_LT(glm::length(quarter - dvec3(4, 0, 0)), 1e-12);
  EXPECT_LT(glm::length(camera_at(first, turn, 4).position - first.position), 1e-12) << "the frame after the last";
}

TEST(CameraMotion, TurnsRoundACenterAndKeepsTheDistance) {
  const Camera first = camera_before({1, 0, 0});
  const CameraMotion turn{.frames = 2, .center = dvec3(0)};
  const Camera half = camera_at(first, turn, 1);
  EXPECT_LT(glm::length(half.focal_point - dvec3(-1, 0, 0)), 1e-12);
  EXPECT_LT(glm::length(half.position - dvec3(-1, 0, -4)), 1e-12);
}

TEST(CameraMotion, ComesNearerByAFactorInAll) {
  const Camera first = camera_before({0, 0, 1});
  const CameraMotion nearer{.frames = 3, .degrees = 0, .factor = 0.25};
  EXPECT_NEAR(camera_at(first, nearer, 1).position.z, 1 + 4 * 0.5, 1e-12);
  EXPECT_NEAR(camera_at(first, nearer, 2).position.z, 1 + 4 * 0.25, 1e-12) << "the last frame";
  EXPECT_EQ(camera_at(first, {.frames = 1, .degrees = 90, .factor = 2}, 0), first) << "a single frame";
}

}  // namespace
}  // namespace splatvol
