// A texture for pictures that were drawn without OpenGL.
#pragma once

#include "base/error.h"
#include "renderer/gl/gl_objects.h"
#include "scene/image.h"

namespace splatvol {

/// Needs the OpenGL context of its first upload in each call.
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
