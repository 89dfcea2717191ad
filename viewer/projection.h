// Where positions are in the window.
#pragma once

#include <imgui.h>

#include <algorithm>
#include <optional>

#include "base/math.h"
#include "scene/scene.h"
#include "viewer/overlay.h"

namespace splatvol {

/// From world coordinates to the window. View and area must outlive it.
class Projection {
 public:
  Projection(const View& view, const PictureArea& area) : view_(view), area_(area) {}

  [[nodiscard]] std::optional<ImVec2> at(const dvec3& position) const {
    constexpr double nearest_share = 1e-6;  // of the distance; a point nearer than this is behind
    const dvec3 p = view_.to_view(position);
    if (!view_.orthographic && !(p.z > nearest_share * glm::length(p))) return {};
    const double f = view_.focal / (view_.orthographic ? 1 : p.z), limit = 1e5;
    return ImVec2(
        static_cast<float>(area_.left + area_.unit_x * std::clamp(0.5 * view_.width + f * p.x, -limit, limit)),
        static_cast<float>(area_.unit_y * std::clamp(0.5 * view_.height - f * p.y, -limit, limit)));
  }

  /// Returns the world units of a window unit, at the depth of a position.
  [[nodiscard]] double world_per_unit(const dvec3& position) const {
    const double depth = view_.orthographic ? 1 : std::max(view_.to_view(position).z, 1e-300);
    return depth / (view_.focal * area_.unit_x);
  }

  /// Returns the way in the world, at the depth of a position, of one in the window.
  [[nodiscard]] dvec3 way_of(const dvec2& moved, const dvec3& position) const {
    return world_per_unit(position) * (moved.x * view_.right - moved.y * view_.up);
  }

 private:
  const View& view_;
  const PictureArea& area_;
};

}  // namespace splatvol
