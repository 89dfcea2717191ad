// An OpenGL context without a window or a display server.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "base/error.h"

namespace splatvol {

enum class ContextKind {
  any,
  hardware,  // on a graphics card
};

/// Returns whether the device that OpenGL names is the processor: Mesa's llvmpipe and the like.
[[nodiscard]] bool is_software_renderer(std::string_view description);

/// Fails if the process may not take the address space that drivers need. They end a program where less is left.
[[nodiscard]] Status check_space_for_drivers();

/// An OpenGL 4.5 core context that draws into its own framebuffers only.
///
/// Tries the EGL devices that are hardware, then Mesa's surfaceless platform (its software rasteriser included), then
/// EGL's default display. The context is current in the thread that created it, and that thread must also destroy it.
class HeadlessContext {
 public:
  /// Creates a context and makes it current. Fails with ErrorCode::device if no platform gives one; the message holds
  /// the answer of each. Fails also as check_space_for_drivers().
  [[nodiscard]] static Result<std::unique_ptr<HeadlessContext>> create(ContextKind kind = ContextKind::any);
  HeadlessContext(const HeadlessContext&) = delete;
  HeadlessContext& operator=(const HeadlessContext&) = delete;
  ~HeadlessContext();

  /// Returns the device and version for provenance: "GL_RENDERER, OpenGL GL_VERSION".
  [[nodiscard]] const std::string& description() const { return description_; }

 private:
  // EGLDisplay and EGLContext are void pointers. EGL's headers bring X11's macros, so they stay out of this header.
  HeadlessContext(void* display, void* context);

  void* display_;
  void* context_;
  std::string description_;
};

}  // namespace splatvol
