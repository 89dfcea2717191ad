#include "scene/scene_change.h"

#include <gtest/gtest.h>

#include <functional>
#include <utility>
#include <vector>

namespace splatvol {
namespace {

using Edit = std::function<void(Scene&)>;

TEST(SceneChange, EachMemberChangesOneThing) {
  const std::vector<std::pair<bool SceneChange::*, Edit>> edits = {
      {&SceneChange::camera, [](Scene& scene) { scene.camera.position.x += 1; }},
      {&SceneChange::size, [](Scene& scene) { scene.width += 1; }},
      {&SceneChange::size, [](Scene& scene) { scene.height += 1; }},
      {&SceneChange::look, [](Scene& scene) { scene.transfer_function.hi += 1; }},
      {&SceneChange::look, [](Scene& scene) { scene.transfer_function.density_factor = 2; }},
      {&SceneChange::look, [](Scene& scene) { scene.lighting.emplace(); }},
      {&SceneChange::look, [](Scene& scene) { scene.opacity->function.hi += 1; }},
      {&SceneChange::parts, [](Scene& scene) { scene.clip_box.emplace(); }},
      {&SceneChange::parts, [](Scene& scene) { scene.clip_planes.emplace_back(); }},
      {&SceneChange::parts, [](Scene& scene) { scene.slices.emplace_back(); }},
      {&SceneChange::parts, [](Scene& scene) { scene.surfaces.emplace_back(); }},
      {&SceneChange::parts, [](Scene& scene) { scene.surfaces[0].near_side = NearSide::hidden; }},
      {&SceneChange::parts, [](Scene& scene) { scene.contours.emplace_back(); }},
      {&SceneChange::parts, [](Scene& scene) { scene.streamlines.emplace_back(); }},
      {&SceneChange::data, [](Scene& scene) { scene.attribute = "other"; }},
      {&SceneChange::frame, [](Scene& scene) { scene.background.r = 1; }},
      {&SceneChange::frame, [](Scene& scene) { scene.outline = !scene.outline; }},
      {&SceneChange::frame, [](Scene& scene) { scene.scalar_bar.ticks += 1; }},
  };
  Scene before;
  before.attribute = "a";
  before.opacity = SceneOpacity{"b", {}};
  before.surfaces = {{.boundary = "wall"}};
  for (std::size_t i = 0; i < edits.size(); ++i) {
    SCOPED_TRACE(i);
    Scene after = before;
    edits[i].second(after);
    const SceneChange change = change_between(before, after);
    for (const auto member : {&SceneChange::camera, &SceneChange::size, &SceneChange::look, &SceneChange::parts,
                              &SceneChange::data, &SceneChange::frame})
      EXPECT_EQ(change.*member, member == edits[i].first);
    EXPECT_EQ(change.is_of_picture(), edits[i].first != &SceneChange::frame);
  }
  EXPECT_FALSE(change_between(before, before).is_of_picture());
}

// The opacity's function goes with its attribute.
TEST(SceneChange, AnotherOpacityIsOtherData) {
  Scene before, after;
  after.opacity = SceneOpacity{"b", {}};
  EXPECT_TRUE(change_between(before, after).data);
  EXPECT_TRUE(change_between(after, before).data);
}

}  // namespace
}  // namespace splatvol
