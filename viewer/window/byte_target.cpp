#include "viewer/window/byte_target.h"

namespace splatvol {

Status ByteTarget::resize(int width, int height) {
  if (width == width_ && height == height_) return {};
  GLuint texture = 0, framebuffer = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &texture);
  texture_ = Texture(texture);
  glTextureParameteri(texture, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureParameteri(texture, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  // A format without a size lets Mesa take the layout of the bytes. GL_RGBA8 would be red first.
  glBindTexture(GL_TEXTURE_2D, texture);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA, width, height, 0, GL_BGRA, GL_UNSIGNED_BYTE, nullptr);
  glBindTexture(GL_TEXTURE_2D, 0);
  glCreateFramebuffers(1, &framebuffer);
  framebuffer_ = Framebuffer(framebuffer);
  glNamedFramebufferTexture(framebuffer, GL_COLOR_ATTACHMENT0, texture, 0);
  width_ = height_ = 0;
  SPLATVOL_TRY(check_gl("a picture for the window"));
  width_ = width, height_ = height;
  return {};
}

Status ByteTarget::write(std::span<const std::uint32_t> pixels) {
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(texture_.name(), 0, 0, 0, width_, height_, GL_BGRA, GL_UNSIGNED_BYTE, pixels.data());
  return check_gl("a picture for the window");
}

void ByteTarget::use() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_BLEND);
}

}  // namespace splatvol
