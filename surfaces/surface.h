// Surfaces of a scene, with their triangles.
#pragma once

#include <functional>
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

/// Reads the triangles of a file. Errors begin with the path.
using ReadSurface = std::function<Result<TriangleMesh>(const std::string& path)>;

/// Returns the surfaces of a scene. Reads the files of those that are shown, but for files that `before` has or that
/// two surfaces share. Fails if a file cannot be read, or if `read` is empty and there is a file to read.
[[nodiscard]] Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles, const ReadSurface& read,
                                                         std::span<const Surface> before = {});

}  // namespace splatvol
