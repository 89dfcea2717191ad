// Streamlines in the viewer, by events.
#include <gtest/gtest.h>

#include <variant>

#include "tests/player/moving_cube.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

constexpr double panel = 336;
constexpr double section_y = 847, add_y = section_y + 22;  // its head, and its button

struct ViewerStreamlines : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_moving(path("m.svol"));
    resize(1100, 1100);
    open({.volume = path("m.svol")});
    settle();
  }
  const View& view() const { return viewer->session()->view(); }
  const SeedLine& line() const { return std::get<SeedLine>(scene().streamlines.at(0).seeds); }

  // Where a position is in the window.
  dvec2 at(const dvec3& position) const {
    const dvec3 p = view().to_view(position);
    return {panel + 0.5 * view().width + view().focal * p.x / p.z, 0.5 * view().height - view().focal * p.y / p.z};
  }
  void drag(const dvec2& from, const dvec2& to) {
    ViewerFixture::drag({from, from + 0.25 * (to - from), from + 0.5 * (to - from), to});
    settle();
  }
};

TEST_F(ViewerStreamlines, SeedsAreDraggedAndUndoGoesBack) {
  const Image before = viewer->session()->image().value();
  click(100, section_y);
  settle();
  click(40, add_y);
  settle();
  ASSERT_EQ(scene().streamlines.size(), 1U);
  EXPECT_EQ(scene().streamlines[0].vector, "U");
  const Image with = viewer->session()->image().value();
  EXPECT_GT(compare_images(with, before)->rmse, 0.01);
  ASSERT_EQ(viewer->session()->streamline_counts().size(), 1U);
  EXPECT_EQ(viewer->session()->streamline_counts()[0].lines, 20U);

  // An end of the line.
  const SeedLine added = line();
  const Camera camera = scene().camera;
  const dvec2 from = at(added.end);
  drag(from, from + dvec2(30, -40));
  EXPECT_EQ(line().start, added.start);
  EXPECT_LT(glm::length(at(line().end) - from - dvec2(30, -40)), 1) << "it follows the pointer";
  EXPECT_NEAR(view().to_view(line().end).z, view().to_view(added.end).z, 1e-6) << "at its depth";
  EXPECT_EQ(scene().camera, camera);
  EXPECT_GT(compare_images(viewer->session()->image().value(), with)->rmse, 0.003);

  // The middle moves all.
  const SeedLine moved = line();
  const dvec2 middle = at(0.5 * (moved.start + moved.end));
  drag(middle, middle + dvec2(-20, 25));
  EXPECT_LT(glm::length(line().end - moved.end - (line().start - moved.start)), 1e-12);
  EXPECT_GT(glm::length(line().end - moved.end), 0.01);

  press_with_control('Z');
  settle();
  EXPECT_EQ(line(), moved);
  press_with_control('Z');
  settle();
  EXPECT_EQ(line(), added);
  EXPECT_EQ(compare_images(viewer->session()->image().value(), with)->max, 0);
  press_with_control('Z');
  settle();
  EXPECT_TRUE(scene().streamlines.empty());
  EXPECT_EQ(compare_images(viewer->session()->image().value(), before)->max, 0);
}

TEST_F(ViewerStreamlines, WithoutAVectorThereAreNone) {
  write_two_attributes(path("v.svol"));
  open({.volume = path("v.svol")});
  settle();
  click(100, section_y);
  settle();
  click(40, add_y);
  settle();
  EXPECT_TRUE(scene().streamlines.empty());
}

}  // namespace
}  // namespace splatvol::test
