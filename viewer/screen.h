// The renderer's picture, shown: over a background, with the sRGB curve.
#pragma once

#include "base/error.h"
#include "base/math.h"
#include "renderer/gl_objects.h"
#include "scene/image.h"

namespace splatvol {

/// Needs the context that was current at `create`.
class Screen {
 public:
  [[nodiscard]] static Result<Screen> create();

  /// Fills width x height pixels of the framebuffer that is bound, from pixel (left, 0) on, with a picture in linear
  /// premultiplied RGBA, stretched where it has another size. As a PNG file of the picture looks.
  [[nodiscard]] Status show(GLuint texture, dvec3 background, int left, int width, int height) const;

 private:
  Program program_;
  VertexArray vertex_array_;
};

/// What the bound framebuffer shows, sRGB, as a linear picture that write_image gives its bytes back.
[[nodiscard]] Result<Image> read_framebuffer(int width, int height);

}  // namespace splatvol
