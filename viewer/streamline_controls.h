// Streamlines: their part of the panel, and handles in the picture that move seeds.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/math.h"
#include "player/session.h"
#include "scene/scene.h"
#include "viewer/overlay.h"

namespace splatvol {

/// Holds which streamlines are selected, and which handle is held. Draws with Dear ImGui.
class StreamlineControls {
 public:
  /// Draws the part of the panel, and changes the session's scene.
  void draw_panel(Session& session);

  /// Draws seeds and handles of the selected streamlines over the picture.
  void draw_handles(const Scene& scene, const View& view, const PictureArea& area) const;

  /// Takes the handle under the pointer. Returns false if there is none: then the drag is for others.
  [[nodiscard]] bool grab(const Scene& scene, const View& view, const PictureArea& area, const dvec2& pointer);

  /// Moves the handle that is held in the plane of the picture. `moved`: of the pointer, since the last call.
  void drag(Scene& scene, const View& view, const PictureArea& area, const dvec2& moved);

  void release() { held_.reset(); }
  [[nodiscard]] bool is_held() const { return held_.has_value(); }

  /// Selects none: for another scene.
  void reset() { selected_.reset(), held_.reset(); }

 private:
  void draw_selected(Session& session, SceneStreamlines& streamlines) const;

  std::optional<std::size_t> selected_;
  std::optional<std::size_t> held_;  // a corner of the seeds, or beyond them the middle, which moves them all
};

}  // namespace splatvol
