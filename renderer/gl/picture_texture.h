// Pictures in textures.
#pragma once

#include "base/error.h"
#include "pictures/image.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/rasterizer.h"

namespace splatvol {

/// Returns a pixel of a picture, counted from the upper left corner. Fails if it is outside. Needs the context of a
/// picture that is in a texture.
[[nodiscard]] Result<vec4> read_pixel(const DevicePicture& picture, int x, int y);

/// A texture for pictures that were drawn without OpenGL. Needs the OpenGL context of its first upload in each call.
class PictureTexture {
 public:
  /// Replaces the picture. The texture's first row is the image's.
  [[nodiscard]] Status upload(const Image& image);

  [[nodiscard]] GLuint name() const { return texture_.name(); }

 private:
  Texture texture_;
  int width_ = 0, height_ = 0;
};

}  // namespace splatvol
