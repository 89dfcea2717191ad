// Moving a camera by hand, and cameras along a path.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "player/camera_control.h"
#include "player/camera_path.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

constexpr Viewport viewport{800, 600};

// At 1e7 from the origin, where single precision would not do.
Camera far_camera(Camera::Projection projection) {
  Camera camera;
  camera.projection = projection;
  camera.parallel_height = 3;
  camera.position = {1e7 + 3, -4, 2};
  camera.focal_point = {1e7, 1, 0.5};
  camera.up = {0.1, 1, 0};
  return camera;
}

// Returns a point's position on the screen, in units of the viewport.
dvec2 seen_at(const Camera& camera, const dvec3& point) {
  const View view = make_view(camera, 800, 600).value();
  const dvec3 p = view.to_view(point);
  const double f = view.focal / (view.orthographic ? 1 : p.z);
  return {400 + f * p.x, 300 - f * p.y};
}

double distance(const Camera& camera) { return glm::length(camera.position - camera.focal_point); }

class Hand : public testing::TestWithParam<Camera::Projection> {
 protected:
  Camera camera = far_camera(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Projections, Hand,
                         testing::Values(Camera::Projection::perspective, Camera::Projection::orthographic));

// Doubles at 1e7 are 2e-9 apart, of distances of 6: pixels are good to 1e-6.
constexpr double pixel_error = 1e-5;

TEST_P(Hand, ZoomKeepsWhatIsUnderThePointer) {
  const dvec2 pointer(123, 456);
  for (const double factor : {0.5, 2.0, 0.9}) {
    const dvec3 point = focal_plane_point(camera, viewport, pointer);
    zoom(camera, viewport, pointer, factor, 1e-6);
    const dvec2 seen = seen_at(camera, point);
    EXPECT_NEAR(seen.x, pointer.x, pixel_error);
    EXPECT_NEAR(seen.y, pointer.y, pixel_error);
  }
  const double before = world_per_pixel(camera, viewport);
  zoom(camera, viewport, pointer, 0.5, 1e-6);
  EXPECT_NEAR(world_per_pixel(camera, viewport) / before, 0.5, 1e-7);
}

TEST_P(Hand, ZoomEndsBeforeTheEyeMeetsTheFocalPoint) {
  for (int i = 0; i < 200; ++i) zoom(camera, viewport, {10, 20}, 0.5, 1e-3);
  EXPECT_TRUE(make_view(camera, 800, 600));
  if (GetParam() == Camera::Projection::perspective)
    EXPECT_NEAR(distance(camera), 1e-3, 1e-7);
  else
    EXPECT_NEAR(camera.parallel_height, 1e-3, 1e-12);
}

TEST_P(Hand, PanFollowsThePointer) {
  const dvec2 from(200, 500), drag(-150, 37);
  const dvec3 point = focal_plane_point(camera, viewport, from);
  pan(camera, viewport, drag);
  const dvec2 seen = seen_at(camera, point);
  EXPECT_NEAR(seen.x, from.x + drag.x, pixel_error);
  EXPECT_NEAR(seen.y, from.y + drag.y, pixel_error);
}

TEST_P(Hand, OrbitKeepsDistanceAndComesBack) {
  const Camera before = camera;
  const double far = distance(camera);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> pixels(-400, 400);
  for (int i = 0; i < 500; ++i) {  // over the poles and back
    orbit(camera, viewport, {pixels(random), pixels(random)});
    ASSERT_TRUE(make_view(camera, 800, 600));
    ASSERT_NEAR(distance(camera), far, 1e-6);
  }
  camera = before;
  // Twice the shorter side is a whole turn to the right.
  for (int i = 0; i < 100; ++i) orbit(camera, viewport, {2 * 600 / 100.0, 0});
  EXPECT_LT(glm::length(camera.position - before.position), 1e-6);
  EXPECT_EQ(camera.focal_point, before.focal_point);
}

TEST_P(Hand, OrbitTurnsWithThePointer) {
  // Things nearer than the focal point move with the pointer.
  const dvec3 nearer = camera.focal_point + 0.1 * (camera.position - camera.focal_point);
  orbit(camera, viewport, {30, 20});
  const dvec2 seen = seen_at(camera, nearer);
  EXPECT_GT(seen.x, 400);
  EXPECT_GT(seen.y, 300);
}

TEST_P(Hand, ChangingTheProjectionKeepsSizes) {
  const double before = world_per_pixel(camera, viewport);
  for (const auto projection : {Camera::Projection::orthographic, Camera::Projection::perspective, GetParam()}) {
    set_projection(camera, projection);
    EXPECT_NEAR(world_per_pixel(camera, viewport) / before, 1, 1e-7);
  }
}

TEST_P(Hand, FlyingMovesAlongTheAxes) {
  const Camera before = camera;
  const CameraAxes axes = axes_of(camera);
  fly(camera, {1, 2, 3}, 0, 0);
  EXPECT_LT(glm::length(camera.position - before.position - (axes.right + 2.0 * axes.up + 3.0 * axes.forward)), 1e-8);
  fly(camera, dvec3(0), 0.3, 0);
  EXPECT_NEAR(glm::dot(axes_of(camera).forward, axes.right), std::sin(0.3), 1e-7);
  fly(camera, dvec3(0), -0.3, 0.2);
  EXPECT_NEAR(glm::dot(axes_of(camera).forward, axes.up), std::sin(0.2), 1e-7);
}

TEST_P(Hand, LooksAlongAxes) {
  look_along(camera, {0, -1, 0}, {0, 0, 1});
  const View view = make_view(camera, 8, 6).value();
  EXPECT_LT(glm::length(view.forward - dvec3(0, -1, 0)), 1e-12);
  EXPECT_LT(glm::length(view.up - dvec3(0, 0, 1)), 1e-12);
}

TEST_P(Hand, RollTurnsThePicture) {
  const CameraAxes before = axes_of(camera);
  roll(camera, std::numbers::pi / 2);
  EXPECT_LT(glm::length(axes_of(camera).up - before.right), 1e-7);
}

class CameraPathFile : public test::FolderTest {
 protected:
  void write(const std::string& text) const { FolderTest::write("path.json", text); }
  const std::string file = path("path.json");
};

TEST_F(CameraPathFile, GoesThroughItsCameras) {
  CameraPath path;
  for (int i = 0; i < 3; ++i) {
    path.views.push_back({far_camera(Camera::Projection::perspective)});
    orbit(path.views.back().camera, viewport, {100.0 * i, 50.0 * i});
    zoom(path.views.back().camera, viewport, {400, 300}, std::exp2(i), 1e-9);
  }
  for (int i = 0; i < 3; ++i) {
    const Camera camera = camera_at(path, i / 2.0);
    EXPECT_LT(glm::length(camera.position - path.views[static_cast<std::size_t>(i)].camera.position), 1e-7) << i;
  }
  double last = 0;
  for (int i = 0; i <= 20; ++i) {
    const Camera camera = camera_at(path, i / 20.0);
    ASSERT_TRUE(make_view(camera, 4, 3));
    EXPECT_GT(distance(camera), last);  // each is twice as far as the one before
    last = distance(camera);
  }
  write(path_to_json(path));
  const auto read = load_camera_path(file);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->views[2].camera.position, path.views[2].camera.position);
  EXPECT_EQ(read->views.size(), 3u);
  EXPECT_EQ(read->views[2].name, "");

  path.views[1].name = "a name, \"quoted\"";
  write(path_to_json(path));
  EXPECT_EQ(load_camera_path(file)->views[1].name, path.views[1].name);
}

TEST_F(CameraPathFile, RefusesWhatIsNone) {
  const std::string camera = camera_to_json(far_camera(Camera::Projection::perspective));
  const std::string other = camera_to_json(far_camera(Camera::Projection::orthographic));
  for (const auto& [text, reason] :
       {std::pair<std::string, std::string>{"[", "not a camera path"},
        {R"({"seconds": 5})", "not a camera path"},
        {R"({"seconds": 5, "cameras": []})", "no cameras"},
        {R"({"seconds": 5, "cameras": [{}]})", "cameras[0]"},
        {fmt::format(R"({{"seconds": 0, "cameras": [{}]}})", camera), "seconds"},
        {fmt::format(R"({{"seconds": 5, "cameras": [{}], "names": ["a", "b"]}})", camera), "not as many as cameras"},
        {fmt::format(R"({{"seconds": 5, "cameras": [{},{}]}})", camera, other), "both projections"}}) {
    write(text);
    const auto path = load_camera_path(file);
    ASSERT_FALSE(path) << text;
    EXPECT_THAT(path.error().message, HasSubstr(reason));
    EXPECT_THAT(path.error().message, HasSubstr(file));
  }
}

// Such text once exhausted the stack.
TEST_F(CameraPathFile, RefusesDeepNesting) {
  constexpr std::size_t levels = 400'000;
  write(R"({"seconds": 5, "cameras": [)" + std::string(levels, '[') + std::string(levels, ']') + "]}");
  const auto path = load_camera_path(file);
  ASSERT_FALSE(path);
  EXPECT_THAT(path.error().message, HasSubstr("nested deeper"));
}

}  // namespace
}  // namespace splatvol
