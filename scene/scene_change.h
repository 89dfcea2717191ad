// What differs between two scenes.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// What a change of a scene changes of its picture.
struct SceneChange {
  bool camera = false;
  bool size = false;         // in pixels
  bool look = false;         // functions of the values, and light
  bool parts = false;        // what cuts the volume, and what is drawn with it
  bool functions = false;    // of the look: those of the values
  bool contours = false;     // of the parts
  bool surfaces = false;     // of the parts
  bool streamlines = false;  // of the parts
  bool data = false;         // the attributes that are shown
  bool frame = false;        // what is round the picture, or under it: the picture itself stays

  /// Whether the picture itself differs.
  [[nodiscard]] bool is_of_picture() const { return camera || is_beyond_camera(); }

  /// Whether it differs by more than the place that it is seen from.
  [[nodiscard]] bool is_beyond_camera() const { return size || look || parts || data; }
};

[[nodiscard]] SceneChange change_between(const Scene& before, const Scene& after);

}  // namespace splatvol
