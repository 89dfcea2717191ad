#include "scene/scene_change.h"

namespace splatvol {
namespace {

std::string attribute_of(const std::optional<SceneOpacity>& opacity) { return opacity ? opacity->attribute : ""; }

}  // namespace

// Names all members: a further one does not compile until it is told here what it changes.
SceneChange change_between(const Scene& before, const Scene& after) {
  const auto& [camera, width, height, background, attribute, function, lighting, clip_box, outline, surfaces, bar,
               slices, clip_planes, opacity, contours, streamlines] = after;
  return {
      .camera = camera != before.camera,
      .size = width != before.width || height != before.height,
      .look = function != before.transfer_function || lighting != before.lighting || opacity != before.opacity,
      .parts = clip_box != before.clip_box || clip_planes != before.clip_planes || slices != before.slices ||
               surfaces != before.surfaces || contours != before.contours || streamlines != before.streamlines,
      .functions = function != before.transfer_function || opacity != before.opacity,
      .contours = contours != before.contours,
      .surfaces = surfaces != before.surfaces,
      .streamlines = streamlines != before.streamlines,
      .data = attribute != before.attribute || attribute_of(opacity) != attribute_of(before.opacity),
      .frame = background != before.background || outline != before.outline || bar != before.scalar_bar,
  };
}

}  // namespace splatvol
