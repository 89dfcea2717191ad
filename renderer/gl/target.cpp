#include "renderer/gl/target.h"

#include <algorithm>
#include <array>

namespace splatvol {

int largest_target_side() {
  GLint largest = 0;
  std::array<GLint, 2> largest_viewport{};
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, largest_viewport.data());

  // A quad holds its pixels as 16-bit numbers.
  return std::min({largest, largest_viewport[0], largest_viewport[1], 65535});
}

Status Target::resize(int width, int height) {
  if (width == width_ && height == height_) return {};
  *this = {};
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  color_ = Texture(name);
  glTextureStorage2D(name, 1, GL_RGBA32F, width, height);
  glCreateFramebuffers(1, &name);
  framebuffer_ = Framebuffer(name);
  glNamedFramebufferTexture(name, GL_COLOR_ATTACHMENT0, color_.name(), 0);
  SPLATVOL_TRY(check_gl("making the picture's memory"));
  if (glCheckNamedFramebufferStatus(name, GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return fail(ErrorCode::device, "this device does not draw into 32-bit float pictures");
  width_ = width;
  height_ = height;
  return {};
}

void Target::clear() const {
  constexpr std::array<GLfloat, 4> transparent_black{};
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearNamedFramebufferfv(framebuffer_.name(), GL_COLOR, 0, transparent_black.data());
}

void Target::use() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_STENCIL_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
}

}  // namespace splatvol
