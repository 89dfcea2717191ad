// Shows the renderer's picture over a background, with the sRGB curve.
#pragma once

#include "base/error.h"
#include "base/math.h"
#include "pictures/image.h"
#include "renderer/gl/gl_objects.h"

namespace splatvol {

/// A picture in a texture of OpenGL.
struct ShownPicture {
  GLuint texture = 0;      // 0: nothing
  bool top_first = false;  // the texture's first row is the picture's highest, not its lowest
  bool encoded = false;    // holds sRGB bytes over the background, and not linear premultiplied RGBA
};

/// Draws a picture into the window's framebuffer. Needs the context that was current at `create`.
class Screen {
 public:
  [[nodiscard]] static Result<Screen> create();

  /// Fills width x height pixels of the framebuffer that is bound, from pixel (left, 0) on, with a picture. Stretches a
  /// picture of another size. The result looks like a PNG file of the picture.
  [[nodiscard]] Status show(const ShownPicture& picture, dvec3 background, int left, int width, int height) const;

 private:
  Program encode_, copy_;
  VertexArray vertex_array_;
};

/// Reads the bound framebuffer, which holds sRGB bytes, as a linear picture. write_image turns it into the same bytes.
[[nodiscard]] Result<Image> read_framebuffer(int width, int height);

}  // namespace splatvol
