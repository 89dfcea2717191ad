// Meshes in the window: svbuild converts them aside.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <thread>

#include "tests/support/programs.h"
#include "tests/support/results.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;

struct MeshesInAWindow : ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    ::setenv("SPLATVOL_CACHE", path("cache").c_str(), 1);
    resize(800, 600);
    open({.recent_files = path("recent.json")});
  }
  void TearDown() override {
    viewer.reset();
    ::unsetenv("SPLATVOL_CACHE");
  }

  void run(const std::string& command) const {
    const Outcome outcome = run_in(path(), command);
    ASSERT_EQ(outcome.code, 0) << outcome.text;
  }
  void make_mesh(const std::string& cells, const std::string& folder = "mesh", int pieces = 1) const {
    run("svgen mesh --cells " + cells + " --pieces " + std::to_string(pieces) + " -o " + folder);
  }
  void wait_until(const std::function<bool()>& is_so) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(3);
    while (!is_so()) {
      ASSERT_LT(std::chrono::steady_clock::now(), end);
      frame({});
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  // Until the whole mesh is there.
  void wait_for_mesh() {
    wait_until([this] { return viewer->session() && viewer->session()->converted(); });
  }
  [[nodiscard]] std::vector<std::string> errors() const {
    std::vector<std::string> texts;
    for (const Messages::Message& message : viewer->messages().all())
      if (message.is_error) texts.push_back(message.text);
    return texts;
  }
};

TEST_F(MeshesInAWindow, AMeshIsConvertedAndKeepsItsName) {
  make_mesh("5000");
  const std::string mesh = path("mesh/piece0.vtu");
  frame({FilesDropped{{mesh}}});
  wait_for_mesh();
  ASSERT_TRUE(viewer->session()) << testing::PrintToString(errors());
  EXPECT_EQ(viewer->title(), mesh + " - svview");
  EXPECT_TRUE(viewer->session()->converted()->was_built);
  EXPECT_EQ(viewer->session()->used_scene().use.file, mesh);
  EXPECT_THAT(read("recent.json"), HasSubstr(mesh));
  settle();
  EXPECT_TRUE(viewer->session()->exact()) << "cells are kept";

  // Again: from the cache.
  press_with_control('W');
  frame({FilesDropped{{mesh}}});
  wait_for_mesh();
  EXPECT_FALSE(viewer->session()->converted()->was_built);
  EXPECT_THAT(errors(), IsEmpty());
}

// The toast at the lower left, above the axes, has the buttons x, y and z.
TEST_F(MeshesInAWindow, AToastAsksWhichAxisIsUp) {
  make_mesh("5000");
  frame({FilesDropped{{path("mesh/piece0.vtu")}}});
  wait_for_mesh();
  frame_seconds = 0.01;  // the toast stays
  settle();
  const auto is_asked = [&] {
    const auto toasts = viewer->messages().toasts();
    return !toasts.empty() && toasts.back().buttons.size() == 3;
  };
  ASSERT_TRUE(is_asked());
  const double x = ViewerState::panel_width + 8;
  std::set<int> chosen;
  for (double at = x; at < x + 160; at += 6) {
    click(at, 600 - 114 - 16);
    settle();
    EXPECT_TRUE(is_asked()) << "for another one";
    chosen.insert(viewer->session()->up_axis());
    dvec3 up(0);
    up[viewer->session()->up_axis()] = 1;
    EXPECT_EQ(scene().camera.up, up);
  }
  EXPECT_THAT(chosen, ElementsAre(0, 1, 2));
  frame({}, 7);
  EXPECT_FALSE(is_asked());
}

TEST_F(MeshesInAWindow, FilesThatAreDroppedTogetherAreOneMesh) {
  make_mesh("5000", "mesh", 2);
  const std::string first = path("mesh/piece0.vtu"), second = path("mesh/piece1.vtu");
  frame({FilesDropped{{first, second}}});
  wait_for_mesh();
  const std::uint64_t points = viewer->session()->info().point_count();
  EXPECT_THAT(viewer->session()->used_scene().use.pieces, ElementsAre(second));

  frame({FilesDropped{{path("mesh")}}});
  wait_until([&] { return viewer->session()->path() == path("mesh"); });
  EXPECT_EQ(viewer->session()->info().point_count(), points) << "the folder is the same mesh";

  frame({FilesDropped{{first}}});
  wait_until([&] { return viewer->session()->path() == first; });
  EXPECT_LT(viewer->session()->info().point_count(), points);
}

TEST_F(MeshesInAWindow, APreviewComesFirstAndWhatIsChangedInItStays) {
  make_mesh("800000");
  frame({FilesDropped{{path("mesh/piece0.vtu")}}});
  wait_until([this] { return viewer->session() != nullptr; });
  ASSERT_FALSE(viewer->session()->converted()) << "the preview comes before the whole";
  EXPECT_EQ(viewer->session()->path(), path("mesh/piece0.vtu"));
  EXPECT_LE(viewer->session()->info().point_count(), 50'000u);
  EXPECT_FALSE(viewer->is_settled());
  drag({{500, 300}, {550, 320}, {600, 340}});
  viewer->session()->scene.transfer_function.colors = {{0, dvec3(1, 0, 0)}, {1, dvec3(0, 1, 0)}};
  frame({});
  const Scene changed = scene();
  wait_for_mesh();
  EXPECT_GT(viewer->session()->info().point_count(), 100'000u);
  EXPECT_EQ(scene().camera, changed.camera);
  EXPECT_EQ(scene().transfer_function, changed.transfer_function);

  // Another mesh in the same window has a preview of its own.
  make_mesh("800000", "other");
  frame({FilesDropped{{path("other/piece0.vtu")}}});
  wait_until([this] { return viewer->session()->path() == path("other/piece0.vtu"); });
  EXPECT_FALSE(viewer->session()->converted());
  press(key::escape);
  EXPECT_TRUE(viewer->session()) << "the preview stays";
}

TEST_F(MeshesInAWindow, EscapeEndsAConversionAndTheFileBeforeStays) {
  write_two_attributes(path("v.svol"));
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  make_mesh("800000");
  frame({FilesDropped{{path("mesh/piece0.vtu")}}});
  for (int i = 0; i < 5; ++i) frame({});
  EXPECT_FALSE(viewer->is_settled());
  press(key::escape);
  settle();
  EXPECT_EQ(viewer->session()->path(), path("v.svol"));
  EXPECT_THAT(errors(), IsEmpty());
  if (!fs::exists(path("cache"))) return;
  for (const auto& entry : fs::directory_iterator(path("cache"))) EXPECT_EQ(entry.path().filename(), "splatvol.lock");
}

TEST_F(MeshesInAWindow, ErrorsOfSvbuildAreToasts) {
  write("bad.vtu", "nonsense");
  frame({FilesDropped{{path("bad.vtu")}}});
  wait_until([this] { return !errors().empty(); });
  EXPECT_THAT(errors()[0], HasSubstr("bad.vtu"));
  frame({FilesDropped{{"https://host.invalid/mesh.vtu"}}});
  wait_until([this] { return errors().size() > 1; });
  EXPECT_THAT(errors()[1], HasSubstr("download it first"));
}

TEST_F(MeshesInAWindow, ASurfaceBecomesOneOfTheScene) {
  write("s.stl",
        "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 .5\nvertex 1 0 .5\nvertex 0 1 .5\nendloop\n"
        "endfacet\nendsolid s\n");
  frame({FilesDropped{{path("s.stl")}}});
  ASSERT_EQ(errors().size(), 1u);
  EXPECT_THAT(errors()[0], HasSubstr("open the volume first"));
  write_two_attributes(path("v.svol"));
  frame({FilesDropped{{path("v.svol")}}});
  settle();
  frame({FilesDropped{{path("s.stl")}}});
  ASSERT_EQ(scene().surfaces.size(), 1u);
  EXPECT_EQ(scene().surfaces[0].file, path("s.stl"));
}

TEST_F(MeshesInAWindow, TheCacheForgetsAMeshThatStaysOpen) {
  make_mesh("5000");
  frame({FilesDropped{{path("mesh/piece0.vtu")}}});
  wait_for_mesh();
  const std::string kept = viewer->session()->converted()->path;
  ASSERT_TRUE(fs::exists(kept));
  const Status forgotten = viewer->session()->forget_converted();
  EXPECT_TRUE(forgotten) << message_of(forgotten);
  EXPECT_FALSE(fs::exists(kept));
  settle();
  EXPECT_TRUE(viewer->drawn());
}

}  // namespace
}  // namespace splatvol::test
