// A camera that turns round something, and comes nearer or goes farther.
#pragma once

#include <optional>

#include "scene/scene.h"

namespace splatvol {

struct CameraMotion {
  int frames = 1;
  double degrees = 360;                        // in all, about the camera's `up`
  double factor = 1;                           // of the distance to the focal point, from the first frame to the last
  std::optional<dvec3> center = std::nullopt;  // that it turns round, in world units; none: the focal point
};

/// Returns the camera of a frame, counted from 0; `first` is that of the first. Whole turns at one distance are a loop:
/// the frame after the last would be the first.
[[nodiscard]] Camera camera_at(const Camera& first, const CameraMotion& motion, int frame);

}  // namespace splatvol
