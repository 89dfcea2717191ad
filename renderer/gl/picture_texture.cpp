#include "renderer/gl/picture_texture.h"

namespace splatvol {

Result<vec4> read_pixel(const DevicePicture& picture, int x, int y) {
  const auto is_outside = [&](int width, int height) { return x < 0 || y < 0 || x >= width || y >= height; };
  const auto fail_outside = [&] {
    return fail(ErrorCode::invalid_argument, "pixel {}, {} is not in the picture", x, y);
  };
  if (const auto* image = std::get_if<const Image*>(&picture)) {
    if (is_outside((*image)->width, (*image)->height)) return fail_outside();
    return (*image)->at(x, y);
  }
  const auto& [name, width, height] = std::get<TexturePicture>(picture);
  if (is_outside(width, height)) return fail_outside();
  vec4 pixel(0);
  glGetTextureSubImage(name, 0, x, height - 1 - y, 0, 1, 1, 1, GL_RGBA, GL_FLOAT, sizeof(pixel), &pixel);
  SPLATVOL_TRY(check_gl("reading a pixel"));
  return pixel;
}

Status PictureTexture::upload(const Image& image) {
  return upload(image.width, image.height, GL_RGBA32F, GL_FLOAT, image.pixels.data());
}

Status PictureTexture::upload(int width, int height, std::span<const std::uint8_t> bytes) {
  return upload(width, height, GL_RGBA8, GL_UNSIGNED_BYTE, bytes.data());
}

Status PictureTexture::upload(int width, int height, GLenum stored_format, GLenum type, const void* pixels) {
  if (width != width_ || height != height_ || stored_format != stored_format_) {
    texture_ = {};
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D, 1, &name);
    texture_ = Texture(name);
    glTextureStorage2D(name, 1, stored_format, width, height);
    width_ = width, height_ = height, stored_format_ = stored_format;
  }
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(texture_.name(), 0, 0, 0, width, height, GL_RGBA, type, pixels);
  return check_gl("a texture for a picture of the processor");
}

}  // namespace splatvol
