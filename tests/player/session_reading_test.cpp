// What a change needs is read aside, while pictures are drawn without it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <thread>

#include "player/camera_control.h"
#include "tests/player/session_fixture.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

// Reads wait while `stalls`.
struct SlowSession : SessionFixture {
  SlowSession() {
    write_two_attributes(path("v.svol"));
    session = open_slow(path("v.svol"));
  }

  std::unique_ptr<Session> session;
};

TEST_F(SlowSession, AnotherAttributeComesWithItsOwnTransferFunction) {
  const Image heat = settled(*session);
  const Camera camera = session->scene.camera;
  session->show_attribute("no such");
  EXPECT_EQ(compare_images(settled(*session), heat)->max, 0);
  EXPECT_EQ(session->troubles().size(), 1U);
  session->show_attribute("a1");
  const Image wind = settled(*session);
  EXPECT_EQ(session->attribute().name, "a1");
  EXPECT_NE(session->scene.transfer_function.hi, session->first_scene().transfer_function.hi);
  EXPECT_EQ(session->scene.camera.position, camera.position);
  EXPECT_GT(compare_images(heat, wind)->rmse, 0.01);
  // Too little memory for any picture: an error, and the viewer goes on with the old settings.
  session->settings.memory = 1000;
  EXPECT_EQ(compare_images(settled(*session), wind)->max, 0);
  EXPECT_EQ(session->troubles().size(), 2U);
  EXPECT_NE(session->settings.memory, 1000U);
  // The other kernel, lit.
  session->settings.drawing.kernel = KernelKind::octant;
  session->scene.lighting = Lighting();
  EXPECT_GT(compare_images(settled(*session), wind)->rmse, 0.001);
}

// While values of another attribute are read, the picture of the first turns.
TEST_F(SlowSession, AnotherAttributeIsReadAside) {
  const Image first = settled(*session);

  stalls = true;
  session->show_attribute("a1");
  draw(*session);
  while (waiting == 0) std::this_thread::yield();
  EXPECT_TRUE(session->is_reading());
  session->scene.camera.position += 0.2 * (session->scene.camera.focal_point - session->scene.camera.position);
  for (int i = 0; i < 20; ++i) draw(*session);
  EXPECT_TRUE(session->is_reading());
  EXPECT_FALSE(session->is_settled());
  EXPECT_EQ(session->attribute().name, "a0");
  EXPECT_GT(compare_images(session->image().value(), first)->rmse, 0.001) << "the camera moves";

  session->cancel_reading();
  EXPECT_EQ(session->scene.attribute, "a0");
  const Image nearer = settled(*session);
  EXPECT_TRUE(session->troubles().empty());

  session->show_attribute("a1");
  draw(*session);
  EXPECT_TRUE(session->is_reading());
  stalls = false;
  EXPECT_GT(compare_images(settled(*session), nearer)->rmse, 0.01);
  EXPECT_EQ(session->attribute().name, "a1");
  EXPECT_NE(session->scene.transfer_function.hi, session->first_scene().transfer_function.hi);
}

TEST_F(SlowSession, TheCameraThatShowsAllIsFoundAside) {
  settled(*session);
  session->show_all();
  settled(*session);
  const Camera all = session->scene.camera;
  session->scene.camera.position += 0.5 * (all.position - all.focal_point);
  set_projection(session->scene.camera, Camera::Projection::orthographic);
  settled(*session);
  const Camera away = session->scene.camera;

  stalls = true;
  const int before = waiting;
  session->show_all();
  while (waiting == before) std::this_thread::yield();
  for (int i = 0; i < 20; ++i) draw(*session);
  EXPECT_TRUE(session->is_fitting());
  EXPECT_EQ(session->scene.camera, away);
  session->cancel_reading();
  EXPECT_FALSE(session->is_fitting());
  settled(*session);
  EXPECT_EQ(session->scene.camera, away);
  EXPECT_TRUE(session->troubles().empty());

  // A camera that moves meanwhile stays.
  session->show_all();
  session->scene.camera.position += 0.1 * (away.position - away.focal_point);
  const Camera moved = session->scene.camera;
  stalls = false;
  settled(*session);
  EXPECT_EQ(session->scene.camera, moved);

  session->show_all();
  settled(*session);
  EXPECT_EQ(session->scene.camera.projection, Camera::Projection::orthographic);
  EXPECT_LT(glm::distance(session->scene.camera.focal_point, all.focal_point), 1e-9);
  EXPECT_TRUE(session->troubles().empty());
}

// The opacity attribute is read aside, too. Until it is there, the picture stays.
TEST_F(SlowSession, OpacityByAnotherAttributeIsReadAside) {
  const Image first = settled(*session);
  EXPECT_FALSE(session->opacity_attribute());

  stalls = true;
  session->show_opacity("a1");
  draw(*session);
  while (waiting == 0) std::this_thread::yield();
  EXPECT_TRUE(session->is_reading());
  EXPECT_FALSE(session->opacity_attribute()) << "of the picture";
  session->cancel_reading();
  EXPECT_FALSE(session->scene.opacity);
  EXPECT_EQ(compare_images(settled(*session), first)->max, 0);
  stalls = false;

  session->show_opacity("a1");
  const Image faded = settled(*session);
  EXPECT_TRUE(session->troubles().empty());
  ASSERT_TRUE(session->scene.opacity);
  EXPECT_EQ(session->opacity_attribute()->name, "a1");
  EXPECT_EQ(session->scene.transfer_function.densities.size(), 1U) << "the opacity is that of a1 alone";
  EXPECT_LE(session->scene.opacity->function.hi, 1);
  EXPECT_GT(std::ranges::max_element(session->opacity_histogram())[0], 0U);
  EXPECT_GT(compare_images(faded, first)->rmse, 0.01);
  EXPECT_EQ(session->explain(), "");

  // Another attribute for the colours: the opacity stays.
  session->show_attribute("a1");
  settled(*session);
  EXPECT_EQ(session->scene.transfer_function.densities.size(), 1U);
  session->show_attribute("a0");
  settled(*session);

  // Factors of 0 hide all, and the window says so.
  session->scene.opacity->function.densities = {{0, 0}};
  settled(*session);
  EXPECT_THAT(session->explain(), HasSubstr("factors hide every value"));

  session->show_opacity("");
  EXPECT_EQ(compare_images(settled(*session), first)->max, 0);
}

}  // namespace
}  // namespace splatvol::test
