// Cameras that follow each other, and the cameras between them.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "scene/scene.h"

namespace splatvol {

/// A camera that somebody may have named.
struct PathView {
  Camera camera;
  std::string name = {};
};

/// Views at equal intervals of time, all of one projection.
struct CameraPath {
  double seconds = 5;  // in all, > 0
  std::vector<PathView> views;
};

/// Returns the camera at `part` of the time, [0, 1]. Focal points move along a straight line, distances (orthographic:
/// heights) change by a constant factor, directions take the shortest turn. Requires at least one view.
[[nodiscard]] Camera camera_at(const CameraPath& path, double part);

/// Write and read JSON, with cameras as in a scene file. Errors name the file.
[[nodiscard]] std::string path_to_json(const CameraPath& path);
[[nodiscard]] Result<CameraPath> load_camera_path(const std::string& file);

}  // namespace splatvol
