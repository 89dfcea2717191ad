// Surfaces of a scene, with their triangles.
#pragma once

#include <array>
#include <cstddef>
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
  bool of_triangles = false;   // values: [triangle] instead, where cells have one value each
};

/// A triangle of NearSide::translucent has this share of the surface's opacity.
inline constexpr double near_side_share = 0.25;

/// A surface of a scene. `mesh` is null if the surface has not been shown yet.
struct Surface {
  SceneSurface style;
  std::shared_ptr<const TriangleMesh> mesh;
  std::vector<std::string> left_out = {};  // patches of the boundary that the mesh lacks, as memory has no room
  std::shared_ptr<const SurfaceValues> values = {};  // of style.color_by; null: it has the style's colour

  [[nodiscard]] bool is_visible() const { return style.shown && style.opacity > 0 && mesh; }

  /// Whether triangles on the near side are drawn unlike the others.
  [[nodiscard]] bool has_near_side() const { return style.near_side != NearSide::shown && !style.boundary.empty(); }

  /// Whether a triangle may be neither opaque nor hidden.
  [[nodiscard]] bool has_translucent() const {
    return style.opacity < 1 || (has_near_side() && style.near_side == NearSide::translucent);
  }

  /// Returns the opacity of a triangle; 0: it is hidden. `from_outside`: its corners run counterclockwise as the eye
  /// sees them.
  [[nodiscard]] double opacity(std::size_t triangle, bool from_outside) const;

  /// Returns the value at a place in a triangle, which has these shares of its corners; NaN: none. A corner without a
  /// value leaves the triangle without one. Requires `values`.
  [[nodiscard]] double value(std::size_t triangle, const std::array<double, 3>& shares) const;
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
