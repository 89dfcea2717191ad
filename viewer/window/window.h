// A window of the desktop, by GLFW.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "player/events.h"
#include "viewer/window/gui.h"

struct GLFWwindow;

namespace splatvol {

/// A window with an OpenGL 4.5 core context, which is current in the thread that made it. One at a time.
class Window {
 public:
  /// Fails with ErrorCode::device if there is no display or no such context.
  [[nodiscard]] static Result<std::unique_ptr<Window>> open(int width, int height, const std::string& title);
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;
  ~Window();

  /// Waits up to `seconds` for events; 0: not at all. Returns the events since the last call. The first call's begin
  /// with the window's size.
  [[nodiscard]] FrameInput take_input(double seconds);

  void swap();
  [[nodiscard]] WindowResized size() const;

  /// The desktop's clipboard, as long as the window lives.
  [[nodiscard]] Clipboard clipboard() const;

  void set_title(const std::string& title);
  [[nodiscard]] bool should_close() const;

 private:
  Window() = default;

  GLFWwindow* window_ = nullptr;
  FrameInput input_;
  double last_ = 0;
};

}  // namespace splatvol
