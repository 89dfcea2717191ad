// Slices and clip planes in the viewer, by events.
#include <gtest/gtest.h>

#include "player/splat_ray.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

constexpr double panel = 336;

double linear(dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; }

struct ViewerSlices : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    build_mesh(lattice(12), linear, path("m.svol"));
    resize(1100, 800);
    open({.volume = path("m.svol")});
    settle();
  }

  void undo() {
    press_with_control('Z');
    settle();
  }
  void drag(const dvec2& from, const dvec2& to) {
    ViewerFixture::drag({from, from + 0.25 * (to - from), from + 0.5 * (to - from), to});
    settle();
  }
  const View& view() const { return viewer->session()->view(); }

  // Where a position is in the window.
  dvec2 at(const dvec3& position) const {
    const dvec3 p = view().to_view(position);
    return {panel + 0.5 * view().width + view().focal * p.x / p.z, 0.5 * view().height - view().focal * p.y / p.z};
  }
  // The handle at the arrow's tip, 70 units from the point.
  dvec2 tip() const {
    const SceneSlice& slice = scene().slices.back();
    const double world = view().to_view(slice.point).z / view().focal;
    return at(slice.point + 70 * world * glm::normalize(slice.normal));
  }
};

TEST_F(ViewerSlices, HandlesMoveAndTurnTheSliceAndUndoGoesBack) {
  const Camera camera = scene().camera;
  const Image before = viewer->session()->image().value();
  press('X');
  settle();
  ASSERT_EQ(scene().slices.size(), 1U);
  const SceneSlice added = scene().slices[0];
  EXPECT_EQ(added.point, camera.focal_point);
  EXPECT_LT(glm::dot(added.normal, view().forward), -0.5) << "it faces the eye";
  const Image sliced = viewer->session()->image().value();
  EXPECT_GT(compare_images(sliced, before)->rmse, 0.04);
  EXPECT_EQ(sliced.at(view().width / 2, view().height / 2).a, 1);

  // The ball in the middle moves the plane along its normal.
  const dvec2 middle = at(added.point), arrow = tip() - middle;
  drag(middle, middle + 0.5 * arrow);
  const SceneSlice moved = scene().slices[0];
  const double along = glm::dot(moved.point - added.point, added.normal);
  EXPECT_GT(along, 0.02);
  EXPECT_NEAR(glm::length(moved.point - added.point - along * added.normal), 0, 1e-9);
  EXPECT_EQ(moved.normal, added.normal);
  EXPECT_LT(glm::length(at(moved.point) - middle - 0.5 * arrow), 8) << "it follows the pointer";

  // The one at the tip turns it.
  const dvec2 from = tip();
  drag(from, from + dvec2(25, 10));
  const SceneSlice turned = scene().slices[0];
  EXPECT_EQ(turned.point, moved.point);
  EXPECT_NEAR(glm::length(turned.normal), 1, 1e-9);
  EXPECT_LT(glm::dot(turned.normal, moved.normal), 0.99);
  EXPECT_LT(glm::length(tip() - from - dvec2(25, 10)), 5);
  EXPECT_EQ(scene().camera, camera) << "the camera stays";
  EXPECT_GT(compare_images(viewer->session()->image().value(), sliced)->rmse, 0.01);

  // Along its normal, from the nearer side.
  press('N');
  settle();
  EXPECT_LT(glm::length(axes_of(scene().camera).forward + turned.normal), 1e-9);
  undo();

  // Beside the handles a drag turns the camera.
  drag({panel + 60, 700}, {panel + 120, 700});
  EXPECT_NE(scene().camera, camera);
  EXPECT_EQ(scene().slices[0], turned);

  undo();
  EXPECT_EQ(scene().camera, camera);
  undo();
  EXPECT_EQ(scene().slices[0], moved);
  undo();
  EXPECT_EQ(scene().slices[0], added);
  undo();
  EXPECT_TRUE(scene().slices.empty());
  EXPECT_EQ(compare_images(viewer->session()->image().value(), before)->max, 0);
}

TEST_F(ViewerSlices, APickReadsTheValue) {
  press('X');
  settle();
  const Session& session = *viewer->session();
  const PickedSplats splats(session.frame()->list, session.frame()->sliced, session.units(), "value");
  TransferFunction clear = session.function_of_splats();
  clear.densities = {{0, 0}};  // the volume in front would have most of the light
  const auto found_at = [&](double x, double y) {
    return pick_splats(splats, scene(), clear, {}, looking_through(view(), x, y));
  };
  const double x = 0.5 * view().width + 11, y = 0.5 * view().height - 7;
  const auto found = found_at(x, y);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->name, "slice 1");
  EXPECT_NEAR(found->values[0].value, linear(found->position), 0.01);
  EXPECT_NEAR(view().slices[0].plane.distance(found->position), 0, 1e-9);
  EXPECT_EQ(found->opacity, 1);
  EXPECT_LT(glm::length(at(found->position) - dvec2(panel + x, y)), 1e-6);
  EXPECT_FALSE(found_at(1, 1)) << "beside the data";
}

}  // namespace
}  // namespace splatvol::test
