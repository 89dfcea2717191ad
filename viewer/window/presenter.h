// Pictures of a graphics card in the window: over a background, with the sRGB curve.
#pragma once

#include <optional>

#include "base/error.h"
#include "base/math.h"
#include "pictures/image.h"
#include "player/events.h"
#include "player/session.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/picture_texture.h"

namespace splatvol {

/// Draws pictures into the window's framebuffer. Needs the context that was current at `create`.
class Presenter {
 public:
  [[nodiscard]] static Result<Presenter> create();

  /// Begins a frame in the framebuffer that is bound. Drawing a picture may bind others.
  void begin();

  /// Returns the framebuffer of the frame.
  [[nodiscard]] GLuint framebuffer() const { return static_cast<GLuint>(frame_); }

  /// Fills `width` columns of the frame with a picture, from `left` on, and the others with a dark colour. Stretches a
  /// picture of another size. The result looks like a PNG file of the picture. A picture without a name is the
  /// background.
  [[nodiscard]] Status show(const TexturePicture& picture, dvec3 background, int left, int width,
                            const WindowResized& window);

  /// Waits for the frame.
  static void finish();

 private:
  Program encode_;
  VertexArray vertex_array_;
  GLint frame_ = 0;
};

/// Returns the opacity of a pixel of the session's picture, counted from the upper left corner. None if the pixel is
/// outside, or the picture has more than the volume. Must not be called while the session draws.
[[nodiscard]] std::optional<double> opacity_at(const Session& session, int x, int y);

/// Reads the bound framebuffer, which holds sRGB bytes, as a linear picture. write_image turns it into the same bytes.
[[nodiscard]] Result<Image> read_framebuffer(int width, int height);

}  // namespace splatvol
