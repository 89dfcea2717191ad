#include "viewer/window/window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <utility>

#include "renderer/gl/context.h"

namespace splatvol {
namespace {

std::string last_error() {
  const char* description = nullptr;
  ::glfwGetError(&description);
  return description ? description : "no reason given";
}

FrameInput& input_of(GLFWwindow* window) { return *static_cast<FrameInput*>(::glfwGetWindowUserPointer(window)); }

WindowResized size_of(GLFWwindow* window) {
  WindowResized size{};
  float scale = 1, scale_y = 1;
  ::glfwGetWindowSize(window, &size.width, &size.height);
  ::glfwGetFramebufferSize(window, &size.pixel_width, &size.pixel_height);
  ::glfwGetWindowContentScale(window, &scale, &scale_y);
  // The system itself scales windows whose units are larger than pixels.
  const double by_system = size.width > 0 ? static_cast<double>(size.pixel_width) / size.width : 1;
  size.content_scale = by_system > 0 ? static_cast<double>(scale) / by_system : 1;
  if (size.pixel_width == 0 || ::glfwGetWindowAttrib(window, GLFW_ICONIFIED)) size.pixel_width = size.pixel_height = 0;
  return size;
}

}  // namespace

Result<std::unique_ptr<Window>> Window::open(int width, int height, const std::string& title) {
  SPLATVOL_TRY(check_space_for_drivers());
  if (!::glfwInit()) return fail(ErrorCode::device, "no window: {}", last_error());
  std::unique_ptr<Window> opened(new Window);
  ::glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
  ::glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
  ::glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  ::glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
  GLFWwindow* window = ::glfwCreateWindow(width, height, title.c_str(), nullptr, nullptr);
  if (!window) return fail(ErrorCode::device, "no window with OpenGL 4.5: {}", last_error());
  opened->window_ = window;
  ::glfwMakeContextCurrent(window);
  ::glfwSwapInterval(1);
  ::glfwSetWindowUserPointer(window, &opened->input_);
  opened->input_.events.push_back(size_of(window));

  ::glfwSetCursorPosCallback(window, [](GLFWwindow* w, double x, double y) {
    input_of(w).events.push_back(PointerMoved{x, y});
  });
  ::glfwSetMouseButtonCallback(window, [](GLFWwindow* w, int button, int action, int) {
    input_of(w).events.push_back(ButtonChanged{button, action == GLFW_PRESS});
  });
  ::glfwSetScrollCallback(window, [](GLFWwindow* w, double x, double y) {
    input_of(w).events.push_back(Scrolled{x, y});
  });
  ::glfwSetKeyCallback(window, [](GLFWwindow* w, int code, int place, int action, int) {
    if (code < 0 || code >= key::count) return;
    const char* name = ::glfwGetKeyName(code, place);
    input_of(w).events.push_back(KeyChanged{key_by_name(code, name ? name : ""), action != GLFW_RELEASE});
  });
  ::glfwSetCharCallback(window,
                        [](GLFWwindow* w, unsigned character) { input_of(w).events.push_back(TextTyped{character}); });
  ::glfwSetDropCallback(window, [](GLFWwindow* w, int count, const char** paths) {
    input_of(w).events.push_back(FilesDropped{{paths, paths + count}});
  });
  ::glfwSetFramebufferSizeCallback(window, [](GLFWwindow* w, int, int) { input_of(w).events.push_back(size_of(w)); });
  ::glfwSetWindowContentScaleCallback(window,
                                      [](GLFWwindow* w, float, float) { input_of(w).events.push_back(size_of(w)); });
  ::glfwSetWindowIconifyCallback(window, [](GLFWwindow* w, int) { input_of(w).events.push_back(size_of(w)); });
  ::glfwSetWindowRefreshCallback(window, [](GLFWwindow* w) { input_of(w).events.push_back(size_of(w)); });
  opened->last_ = ::glfwGetTime();
  return opened;
}

Window::~Window() {
  if (window_) ::glfwDestroyWindow(window_);
  ::glfwTerminate();
}

FrameInput Window::take_input(double seconds) {
  if (seconds > 0)
    ::glfwWaitEventsTimeout(seconds);
  else
    ::glfwPollEvents();
  const double now = ::glfwGetTime();
  input_.seconds = now - std::exchange(last_, now);
  return std::exchange(input_, {});
}

void Window::swap() { ::glfwSwapBuffers(window_); }

WindowResized Window::size() const { return size_of(window_); }

Clipboard Window::clipboard() const {
  return {[window = window_](const std::string& text) { ::glfwSetClipboardString(window, text.c_str()); },
          [window = window_]() -> std::string {
            const char* text = ::glfwGetClipboardString(window);
            return text ? text : "";
          }};
}

void Window::set_title(const std::string& title) { ::glfwSetWindowTitle(window_, title.c_str()); }

bool Window::should_close() const { return ::glfwWindowShouldClose(window_); }

}  // namespace splatvol
