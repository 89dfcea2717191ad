// Cameras that follow each other, and those in between.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "scene/scene.h"

namespace splatvol {

/// From one to the next in equal times, all of one projection.
struct CameraPath {
  double seconds = 5;  // in all, > 0
  std::vector<Camera> cameras;
};

/// At `part` of the time, [0, 1]: focal points along a straight line, distances (orthographic: heights) by a factor,
/// directions by the shortest turn. Requires at least one camera.
[[nodiscard]] Camera camera_at(const CameraPath& path, double part);

/// JSON; cameras as in a scene file.
[[nodiscard]] std::string path_to_json(const CameraPath& path);
[[nodiscard]] Result<CameraPath> load_camera_path(const std::string& file);

}  // namespace splatvol
