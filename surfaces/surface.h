// Surfaces of a scene, with their triangles.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "scene/scene.h"

namespace splatvol {

/// A surface of a scene. `mesh` is null if the surface has not been shown yet.
struct Surface {
  SceneSurface style;
  std::shared_ptr<const TriangleMesh> mesh;

  [[nodiscard]] bool is_visible() const { return style.shown && style.opacity > 0 && mesh; }
};

/// Returns the surfaces of a scene, and reads the files of those that are shown. A file that `before` has is not read
/// again, and a file of two surfaces is read once. Fails if a file cannot be read, or if `read` is empty and there is a
/// file to read.
[[nodiscard]] Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles, const ReadSurface& read,
                                                         std::span<const Surface> before = {});

}  // namespace splatvol
