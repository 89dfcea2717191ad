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
  if (image.width != width_ || image.height != height_) {
    texture_ = {};
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D, 1, &name);
    texture_ = Texture(name);
    glTextureStorage2D(name, 1, GL_RGBA32F, image.width, image.height);
    width_ = image.width, height_ = image.height;
  }
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(texture_.name(), 0, 0, 0, width_, height_, GL_RGBA, GL_FLOAT, image.pixels.data());
  return check_gl("a texture for a picture of the processor");
}

}  // namespace splatvol
