#include "renderer/gl/picture_texture.h"

namespace splatvol {

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
  glTextureSubImage2D(texture_.name(), 0, 0, 0, image.width, image.height, GL_RGBA, GL_FLOAT, image.pixels.data());
  return check_gl("a texture for a picture of the processor");
}

}  // namespace splatvol
