// Dear ImGui on OpenGL 4.5, fed with recorded or live events.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "base/error.h"
#include "player/events.h"
#include "renderer/gl/gl_objects.h"

struct ImDrawData;
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
  /// `scale`: of the first window's content, for which the font is made.
  [[nodiscard]] static Result<std::unique_ptr<Gui>> create(double scale, Clipboard clipboard = {});
  Gui(const Gui&) = delete;
  Gui& operator=(const Gui&) = delete;
  ~Gui();

  /// Begins a frame of this window, in a light or a dark theme. Between `begin` and `draw` Dear ImGui's functions may
  /// be called.
  [[nodiscard]] Status begin(const FrameInput& input, const WindowResized& window, bool light = false);

  /// Draws the frame over the framebuffer that is bound, which has the window's size in pixels.
  [[nodiscard]] Status draw();

  /// Return whether the pointer's or the keyboard's events are meant for the interface and not for the picture.
  [[nodiscard]] bool has_pointer() const;
  [[nodiscard]] bool has_keyboard() const;

 private:
  Gui() = default;
  [[nodiscard]] Status make_font(double scale);
  static void set_style(double scale, bool light);
  [[nodiscard]] Status upload(const ImDrawData& data);
  void set_state(const ImDrawData& data, int width, int height) const;

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
