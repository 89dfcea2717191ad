// Files that open slowly: the window goes on.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>

#include "player/camera_control.h"
#include "tests/support/results.h"
#include "tests/support/scripted_server.h"
#include "tests/support/stalled_source.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr int width = 800, height = 600;

struct SlowFiles : test::ViewerFixture {
  void SetUp() override { write_two_attributes("v.svol"); }
};

// A session without a window, whose reads wait while `stalls`.
struct SlowFilesInASession : SlowFiles {
  void SetUp() override {
    SlowFiles::SetUp();
    const auto open = [this](const std::string& file) { return open_stalled(file, stalls, waiting); };
    ViewSettings settings{.device = Device::cpu, .in_current_context = false};
    auto read = value_of(Session::read({.file = path("v.svol")}, "", settings, open));
    session = Session::open(std::move(read), host).value();
  }

  void draw() { ASSERT_TRUE(session->draw(200, 150, 1)); }
  void settle() {
    do draw();
    while (!session->is_settled());
  }
  Image settled() {
    settle();
    return session->image().value();
  }

  std::atomic<bool> stalls = false;
  std::atomic<int> waiting = 0;
  std::unique_ptr<Session> session;
};

struct SlowFilesInAWindow : SlowFiles {
  void SetUp() override {
    SlowFiles::SetUp();
    ViewerFixture::SetUp();
    resize(width, height);
    open({.recent_files = path("state/recent.json")});
  }
  std::string opened() const { return viewer->session() ? viewer->session()->path() : ""; }
};

TEST_F(SlowFilesInAWindow, AServerThatStallsIsGivenUpByAKey) {
  const ScriptedServer server({Reply{"", Reply::Then::stall}});
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
  const Image before = screen();

  frame({FilesDropped{{server.url("far.svol")}}});
  while (server.requests().empty()) std::this_thread::yield();
  for (int i = 0; i < 5; ++i) frame({});
  EXPECT_FALSE(viewer->is_settled());
  EXPECT_EQ(opened(), path("v.svol")) << "the file before stays";
  EXPECT_GT(compare_images(screen(), before)->rmse, 0.001) << "words tell of it";

  press(key::f1);
  press(key::escape);
  frame({});
  EXPECT_FALSE(viewer->is_settled()) << "the list of keys began after it";
  press(key::escape);
  settle();
  EXPECT_TRUE(viewer->messages().all().empty());
  EXPECT_EQ(opened(), path("v.svol"));
  EXPECT_EQ(compare_images(screen(), before)->max, 0);
}

TEST_F(SlowFilesInAWindow, ClosingDoesNotWaitForAServer) {
  const ScriptedServer server({Reply{"", Reply::Then::stall}});
  frame({FilesDropped{{server.url("far.svol")}}});
  while (server.requests().empty()) std::this_thread::yield();
  const auto start = std::chrono::steady_clock::now();
  viewer.reset();
  // The stall would be ended after half a minute.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(15));
}

TEST_F(SlowFilesInAWindow, WhatCannotBeOpenedLeavesTheFileBefore) {
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  frame({FilesDropped{{path("no-such.svol")}}});
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
  ASSERT_EQ(viewer->messages().toasts().size(), 1u);
  EXPECT_THAT(viewer->messages().toasts()[0].text, HasSubstr("no-such.svol"));
}

TEST_F(SlowFilesInAWindow, TheDialogOpensAFileByItsPathAndByAClick) {
  press_with_control('O');
  frame({});
  for (const char c : path("v.svol")) frame({TextTyped{static_cast<std::uint32_t>(c)}});
  press(key::enter);
  settle();
  EXPECT_EQ(opened(), path("v.svol"));

  press_with_control('W');
  frame({});
  EXPECT_EQ(viewer->session(), nullptr);

  // The dialog begins in the folder of the time before. Its second entry is the file; the first is the folder "state".
  press_with_control('O');
  frame({});
  click(width / 2, height / 2 - 210 + 131);
  settle();
  EXPECT_EQ(opened(), path("v.svol"));
}

TEST_F(SlowFiles, RecentFilesAreKept) {
  const std::string list = path("state/recent.json");
  {
    RecentFiles recent(list);
    EXPECT_TRUE(recent.paths().empty());
    recent.add("/data/a.svol");
    recent.add("https://host/b.svol");
    recent.add("https://user:secret@host/c.svol");
    recent.add("https://host/d.svol?key=secret");
    recent.add("ssh://user@host/e.svol");
    recent.add("/data/a.svol");
  }
  EXPECT_THAT(RecentFiles(list).paths(), ElementsAre("/data/a.svol", "ssh://user@host/e.svol", "https://host/b.svol"));
  RecentFiles recent(list);
  for (int i = 0; i < 100; ++i) recent.add(fmt::format("/data/{}.svol", i));
  EXPECT_EQ(RecentFiles(list).paths().size(), 12U);
  EXPECT_EQ(RecentFiles(list).paths().front(), "/data/99.svol");
  for (const char* damaged : {"", "{}", "[1, 2", "[[[[]]]]", "[3]"}) {
    write("state/recent.json", damaged);
    EXPECT_TRUE(RecentFiles(list).paths().empty()) << damaged;
  }
}

// While values of another attribute are read, the picture of the first turns.
TEST_F(SlowFilesInASession, AnotherAttributeIsReadAside) {
  const Image first = settled();

  stalls = true;
  session->show_attribute("a1");
  draw();
  while (waiting == 0) std::this_thread::yield();
  EXPECT_TRUE(session->is_reading());
  session->scene.camera.position += 0.2 * (session->scene.camera.focal_point - session->scene.camera.position);
  for (int i = 0; i < 20; ++i) draw();
  EXPECT_TRUE(session->is_reading());
  EXPECT_FALSE(session->is_settled());
  EXPECT_EQ(session->attribute().name, "a0");
  EXPECT_GT(compare_images(session->image().value(), first)->rmse, 0.001) << "the camera moves";

  session->cancel_reading();
  EXPECT_EQ(session->scene.attribute, "a0");
  const Image nearer = settled();
  EXPECT_TRUE(session->troubles().empty());

  session->show_attribute("a1");
  draw();
  EXPECT_TRUE(session->is_reading());
  stalls = false;
  EXPECT_GT(compare_images(settled(), nearer)->rmse, 0.01);
  EXPECT_EQ(session->attribute().name, "a1");
  EXPECT_NE(session->scene.transfer_function.hi, session->first_scene().transfer_function.hi);
}

TEST_F(SlowFilesInASession, TheCameraThatShowsAllIsFoundAside) {
  settle();
  session->show_all();
  settle();
  const Camera all = session->scene.camera;
  session->scene.camera.position += 0.5 * (all.position - all.focal_point);
  set_projection(session->scene.camera, Camera::Projection::orthographic);
  settle();
  const Camera away = session->scene.camera;

  stalls = true;
  const int before = waiting;
  session->show_all();
  while (waiting == before) std::this_thread::yield();
  for (int i = 0; i < 20; ++i) draw();
  EXPECT_TRUE(session->is_fitting());
  EXPECT_EQ(session->scene.camera, away);
  session->cancel_reading();
  EXPECT_FALSE(session->is_fitting());
  settle();
  EXPECT_EQ(session->scene.camera, away);
  EXPECT_TRUE(session->troubles().empty());

  // A camera that moves meanwhile stays.
  session->show_all();
  session->scene.camera.position += 0.1 * (away.position - away.focal_point);
  const Camera moved = session->scene.camera;
  stalls = false;
  settle();
  EXPECT_EQ(session->scene.camera, moved);

  session->show_all();
  settle();
  EXPECT_EQ(session->scene.camera.projection, Camera::Projection::orthographic);
  EXPECT_LT(glm::distance(session->scene.camera.focal_point, all.focal_point), 1e-9);
  EXPECT_TRUE(session->troubles().empty());
}

// The opacity attribute is read aside, too. Until it is there, the picture stays.
TEST_F(SlowFilesInASession, OpacityByAnotherAttributeIsReadAside) {
  const Image first = settled();
  EXPECT_FALSE(session->opacity_attribute());

  stalls = true;
  session->show_opacity("a1");
  draw();
  while (waiting == 0) std::this_thread::yield();
  EXPECT_TRUE(session->is_reading());
  EXPECT_FALSE(session->opacity_attribute()) << "of the picture";
  session->cancel_reading();
  EXPECT_FALSE(session->scene.opacity);
  EXPECT_EQ(compare_images(settled(), first)->max, 0);
  stalls = false;

  session->show_opacity("a1");
  const Image faded = settled();
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
  static_cast<void>(settled());
  EXPECT_EQ(session->scene.transfer_function.densities.size(), 1U);
  session->show_attribute("a0");
  static_cast<void>(settled());

  // Factors of 0 hide all, and the window says so.
  session->scene.opacity->function.densities = {{0, 0}};
  static_cast<void>(settled());
  EXPECT_THAT(session->explain(), HasSubstr("factors hide every value"));

  session->show_opacity("");
  EXPECT_EQ(compare_images(settled(), first)->max, 0);
}

}  // namespace
}  // namespace splatvol::test
