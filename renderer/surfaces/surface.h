// Surfaces of a scene, with their triangles.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "scene/scene.h"

namespace splatvol {

/// The values that colour a surface.
struct SurfaceValues {
  std::string attribute;
  std::string file;            // where they are from
  std::uint64_t step_key = 0;  // as Volume has it
  std::vector<double> values;  // [point of the mesh]; NaN: none
};

/// A surface of a scene. `mesh` is null if the surface has not been shown yet.
struct Surface {
  SceneSurface style;
  std::shared_ptr<const TriangleMesh> mesh;
  std::vector<std::string> left_out = {};  // patches of the boundary that the mesh lacks, as memory has no room
  std::shared_ptr<const SurfaceValues> values = {};  // of style.color_by; null: it has the style's colour

  [[nodiscard]] bool is_visible() const { return style.shown && style.opacity > 0 && mesh; }
};

/// Where triangles come from.
struct SurfaceReaders {
  ReadSurface file;      // by its path; empty: files are refused
  ReadSurface boundary;  // of SceneSurface::boundary
};

/// Returns the surfaces of a scene, and reads those that are shown. Triangles that `before` has are not read again, and
/// those of two surfaces are read once. Fails if they cannot be read.
[[nodiscard]] Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles,
                                                         const SurfaceReaders& readers,
                                                         std::span<const Surface> before = {});

}  // namespace splatvol
