// Dear ImGui on OpenGL 4.5, fed with recorded or live events.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "base/error.h"
#include "base/math.h"
#include "player/events.h"
#include "renderer/gl/gl_objects.h"
#include "viewer/window/pixel_rect.h"

struct ImDrawList;
struct ImGuiContext;

namespace splatvol {

/// The desktop's clipboard. Without one, the interface has one of its own.
struct Clipboard {
  std::function<void(const std::string&)> copy = {};
  std::function<std::string()> paste = {};
};

/// Holds the interface's state and draws it. One at a time; needs the context that was current at `create`.
class Gui {
 public:
  using Lists = std::span<const ImDrawList* const>;

  /// `scale`: of the first window's content, for which the font is made.
  [[nodiscard]] static Result<std::unique_ptr<Gui>> create(double scale, Clipboard clipboard = {});
  Gui(const Gui&) = delete;
  Gui& operator=(const Gui&) = delete;
  ~Gui();

  /// Begins a frame of this window, in a light or a dark theme. Between `begin` and `end` Dear ImGui's functions may
  /// be called.
  [[nodiscard]] Status begin(const FrameInput& input, const WindowResized& window, bool light = false);

  /// Ends the frame. Draws nothing.
  void end();

  /// Draws the frame over the framebuffer that is bound, which has the window's size in pixels. Requires `end`.
  [[nodiscard]] Status draw();

  /// The two parts of the frame, valid until the next one begins: what lies over the picture, and the windows over
  /// that.
  [[nodiscard]] Lists overlays() const;
  [[nodiscard]] Lists windows() const;

  /// Returns the pixels of a window unit in this frame.
  [[nodiscard]] dvec2 pixels_of_unit() const;

  /// Draws lists of the frame as `draw` does, within some rectangles. `top_first`: the first row of the framebuffer is
  /// the highest one.
  [[nodiscard]] Status draw(Lists lists, std::span<const PixelRect> within, bool top_first);

  /// Return whether the pointer's or the keyboard's events are meant for the interface and not for the picture.
  [[nodiscard]] bool has_pointer() const;
  [[nodiscard]] bool has_keyboard() const;

 private:
  Gui() = default;
  [[nodiscard]] Status make_font(double scale);
  static void set_style(double scale, bool light);
  [[nodiscard]] Lists lists() const;
  [[nodiscard]] Status upload(Lists lists);
  void set_state(int width, int height, bool top_first) const;

  ImGuiContext* context_ = nullptr;
  Clipboard clipboard_;
  std::string copied_;  // without a desktop's clipboard, or what it holds
  Program program_;
  VertexArray vertex_array_;
  Buffer vertices_{"vertices of the interface"};
  Buffer indices_{"indices of the interface"};
  Texture font_;
  double scale_ = 0;                          // of the font
  std::pair<double, bool> styled_{0, false};  // scale and theme of the style
};

}  // namespace splatvol
