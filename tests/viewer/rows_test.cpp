// Rows of the panel stay under the pointer: a second click at the same place meets the same control.
#include <gtest/gtest.h>

#include "format/boundary.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

struct PanelRows : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_two_attributes(path("v.svol"));
    resize(800, 1000);
    open({.volume = path("v.svol")});
    settle();
  }
  void click_and_settle(double x, double y) {
    click(x, y);
    settle();
  }
  void open_planes() { click_and_settle(100, 747); }

  static constexpr double contours_y = 769;  // the section's head
  // Where the section of the planes begins.
  static constexpr double add_slice_y = 769, first_row_y = 791, row_height = 25;
};

// A contour is added below the button, and between the others.
TEST_F(PanelRows, ContoursAreAddedBelowTheButton) {
  click_and_settle(100, contours_y);
  const double add_y = contours_y + 22, first_y = add_y + 58;  // a note of two lines comes between: there are no cells
  click_and_settle(40, add_y);
  click_and_settle(40, add_y);
  ASSERT_EQ(scene().contours.size(), 2u);
  const TransferFunction function = scene().transfer_function;
  EXPECT_DOUBLE_EQ(scene().contours[0].values[0], function.value_at(0.5));
  EXPECT_DOUBLE_EQ(scene().contours[1].values[0], function.value_at(0.25));
  click_and_settle(17, first_y);
  EXPECT_FALSE(scene().contours[0].shown);
  click_and_settle(17, first_y);
  EXPECT_TRUE(scene().contours[0].shown);
  // Its line in the histogram: dragged at the upper end. Without the section, no scroll bar takes from the width.
  click_and_settle(100, contours_y);
  const double histogram_left = 8, histogram_right = 328, histogram_y = 104;
  const double middle = 0.5 * (histogram_left + histogram_right);
  drag({{middle, histogram_y}, {middle + 20, histogram_y}, {middle + 40, histogram_y + 30}});
  settle();
  EXPECT_NEAR(scene().contours[0].values[0], function.value_at(0.5 + 40 / (histogram_right - histogram_left)), 0.01);
  EXPECT_EQ(scene().transfer_function.densities.size(), function.densities.size()) << "no control point is added";
  press_with_control('Z');
  settle();
  EXPECT_DOUBLE_EQ(scene().contours[0].values[0], function.value_at(0.5));
}

TEST_F(PanelRows, PlanesAreAddedAndSelectedBelowTheClick) {
  open_planes();
  click_and_settle(40, add_slice_y);
  click_and_settle(40, add_slice_y);
  ASSERT_EQ(scene().slices.size(), 2u);
  const double third_row_y = first_row_y + 2 * row_height, axes_y = third_row_y + 22;
  const auto turn_to_x = [&](double row) {
    click_and_settle(45, row);
    click_and_settle(14, axes_y);  // the button "x" of the selected one
  };
  const dvec3 before = scene().slices[0].normal;
  ASSERT_NE(before, dvec3(1, 0, 0));
  turn_to_x(first_row_y);
  EXPECT_EQ(scene().slices[0].normal, dvec3(1, 0, 0));
  EXPECT_EQ(scene().slices[1].normal, before);
  turn_to_x(first_row_y + row_height);
  EXPECT_EQ(scene().slices[1].normal, dvec3(1, 0, 0));
  click_and_settle(130, first_row_y);  // "remove"
  EXPECT_EQ(scene().slices.size(), 1u);
  click_and_settle(40, add_slice_y);
  EXPECT_EQ(scene().slices.size(), 2u);
}

struct PatchRows : PanelRows {
  // A file with three patches.
  void SetUp() override;
  static constexpr double inlet = 640, wall = 665, outlet = 690;
};

void PatchRows::SetUp() {
  PanelRows::SetUp();
  TriangleMesh triangle;
  triangle.points = {dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0)};
  triangle.triangles = {{0, 1, 2}};
  TestVolume volume = make_test_volume(random_points(50, 3u), {std::vector<double>(50, 1.0)});
  const std::vector<Patch> patches = {{"inlet", triangle}, {"wall", triangle}, {"outlet", triangle}};
  auto packed = format::pack_boundary(patches, 0);
  volume.info.boundary = packed->info;
  volume.boundary = packed->section;
  ASSERT_TRUE(write_test_volume(volume, path("patches.svol")));
  open({.volume = path("patches.svol")});
  settle();
  ASSERT_TRUE(scene().surfaces.empty());
}

TEST_F(PatchRows, KeepTheirPlacesWhenPatchesBecomeSurfaces) {
  click_and_settle(17, outlet);
  click_and_settle(17, inlet);
  ASSERT_EQ(scene().surfaces.size(), 2u);
  EXPECT_EQ(scene().surfaces[0].boundary, "outlet");
  EXPECT_EQ(scene().surfaces[1].boundary, "inlet");
  EXPECT_EQ(scene().surfaces[1].near_side, NearSide::hidden) << "it would hide the cells";
  click_and_settle(17, outlet);
  EXPECT_FALSE(scene().surfaces[0].shown);
  EXPECT_TRUE(scene().surfaces[1].shown);
}

// A click on a name selects the surface that the controls below the list change; without one, they change all.
TEST_F(PatchRows, SetTheLookOfASurface) {
  const double color_y = 759, opacity_y = 784, near_side_y = 809, row = 17;  // of a menu
  const auto choose_near_side = [&](int entry) {
    click_and_settle(100, near_side_y);
    click_and_settle(60, near_side_y + row * (1.4 + entry));
  };
  click_and_settle(60, inlet);
  click_and_settle(17, wall);
  const std::vector<SceneSurface>& surfaces = viewer->session()->scene.surfaces;
  ASSERT_EQ(surfaces.size(), 2u);
  EXPECT_TRUE(surfaces[0].shown);
  choose_near_side(1);
  EXPECT_EQ(surfaces[0].near_side, NearSide::translucent);
  EXPECT_EQ(surfaces[1].near_side, NearSide::hidden);
  drag({{120, opacity_y}, {60, opacity_y}});
  settle();
  EXPECT_LT(surfaces[0].opacity, 0.5);
  EXPECT_EQ(surfaces[1].opacity, 1);
  click_and_settle(60, inlet);  // no surface is selected
  choose_near_side(0);
  for (const SceneSurface& surface : surfaces) EXPECT_EQ(surface.near_side, NearSide::shown) << surface.boundary;
  drag({{40, color_y}, {80, color_y}});  // less or more red
  settle();
  EXPECT_EQ(surfaces[0].color, surfaces[1].color);
  EXPECT_NE(surfaces[0].color, SceneSurface{}.color);
  press_with_control('Z');
  settle();
  for (const SceneSurface& surface : surfaces) EXPECT_EQ(surface.color, SceneSurface{}.color);
}

// The factors of the opacity stay while values are read.
TEST_F(PanelRows, StayWhileValuesAreRead) {
  viewer->session()->show_opacity("a1");
  frame({PointerMoved{-1, -1}});
  settle();
  const auto rows_below = [&] {
    std::vector<vec4> pixels;
    const Image image = screen();
    for (int y = 560; y < 1000; ++y)
      for (int x = 0; x < 336; ++x) pixels.push_back(image.at(x, y));
    return pixels;
  };
  const std::vector<vec4> before = rows_below();
  bool has_read = false;
  for (int tries = 0; tries < 100 && !has_read; ++tries) {
    viewer->session()->show_attribute(scene().attribute == "a0" ? "a1" : "a0");
    frame({});
    has_read = viewer->session()->is_reading();
    frame({});  // the panel is drawn before what was read is taken
    EXPECT_TRUE(rows_below() == before);
    settle();
  }
  EXPECT_TRUE(has_read);
}

}  // namespace
}  // namespace splatvol::test
