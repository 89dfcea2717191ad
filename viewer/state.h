// What the parts of the viewer share.
#pragma once

#include <array>
#include <memory>
#include <optional>

#include "player/events.h"
#include "player/session.h"
#include "player/steering.h"
#include "player/thread_host.h"
#include "viewer/messages.h"
#include "viewer/overlay.h"

namespace splatvol {

/// What is shown besides the picture.
struct Shown {
  bool panel = true, covering_panel = false, panel_right = false;
  bool help = false, hud = true, axes = true, scalar_bar = true, cut = false, values = true;
  bool light = false;  // the interface's theme
};

struct ViewerState {
  static constexpr double panel_width = 336;  // at scale 1

  ThreadHost host;
  std::unique_ptr<Session> session;  // null: no file is open
  Status drawn;                      // of its last picture
  Steering steering;
  WindowResized window{0, 0, 0, 0, 1};
  Shown shown;
  Messages messages;
  int pending_frames = 0;  // the interface settles a frame after a change

  /// Beside the panel, and at least one pixel wide.
  [[nodiscard]] PictureArea picture_area() const;

  /// Returns the window units that a pixel of the session's picture takes: one of another size is stretched.
  [[nodiscard]] dvec2 window_units() const;

  /// Returns where a position is in the window; none behind the eye. Requires a session.
  [[nodiscard]] std::optional<dvec2> window_position(const dvec3& position) const;

  /// Returns the size of the window's picture, in pixels.
  [[nodiscard]] std::array<int, 2> picture_size() const;

  [[nodiscard]] float scale() const { return static_cast<float>(window.content_scale); }

  // Beside a panel, the picture would be too narrow: the panel covers it, and is hidden at first.
  [[nodiscard]] bool is_narrow() const { return window.width < 1.75 * panel_width * window.content_scale; }
  [[nodiscard]] bool& panel() { return is_narrow() ? shown.covering_panel : shown.panel; }
  [[nodiscard]] bool is_minimised() const { return window.pixel_width <= 0 || window.pixel_height <= 0; }
};

}  // namespace splatvol
