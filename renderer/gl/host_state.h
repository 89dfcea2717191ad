// The state of a host program's OpenGL context. Internal to the renderer.
#pragma once

#include <epoxy/gl.h>

#include <functional>
#include <vector>

namespace splatvol {

/// Keeps the state that the renderer changes or relies on, and sets what it relies on. Its end puts all back. The
/// host's framebuffer and viewport stay until the renderer changes them. Errors that the host has not fetched are
/// forgotten.
///
/// Cannot put aside a query, conditional rendering or transform feedback that is active.
class HostState {
 public:
  HostState();
  HostState(const HostState&) = delete;
  HostState& operator=(const HostState&) = delete;
  ~HostState();

 private:
  void keep_fragment_state();
  void keep_primitive_state();
  void keep_bindings();
  void keep_textures();
  void keep_pixel_transfers();
  void keep_blending(GLuint target);
  void keep_viewport(GLuint viewport);
  void keep_buffers(GLenum target, GLenum binding, GLenum start, GLenum size, GLuint count);

  std::vector<std::function<void()>> restores_;  // the last one first
};

}  // namespace splatvol
