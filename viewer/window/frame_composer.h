// The frames of a window where the processor draws the picture: mostly copies.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/error.h"
#include "player/session.h"
#include "renderer/gl/gl_objects.h"
#include "viewer/window/byte_target.h"
#include "viewer/window/gui.h"
#include "viewer/window/gui_lists.h"

namespace splatvol {

/// What a frame is made of, besides the interface.
struct FrameParts {
  const EncodedPicture* picture = nullptr;  // a width of 0: black
  bool is_new = false;                      // another picture than that of the frame before
  int left = 0, width = 1;                  // the picture's columns; the others are dark
  int pixel_width = 1, pixel_height = 1;    // of the framebuffer
  bool is_lost = false;                     // the framebuffer lacks the frame before, or has another size
  double seconds = 0;                       // since the frame before
};

/// Draws frames into the window's framebuffer, each one as a whole: after a swap, nothing of the last one is there.
/// Without a change it draws nothing. OpenGL may be drawn by the processor, too: the picture is copied, not drawn. The
/// interface's windows are kept in a layer. Only their changed parts are drawn into it, and it is blended only where
/// they lie over the picture. Needs the context that was current at `create`.
class FrameComposer {
 public:
  [[nodiscard]] static Result<FrameComposer> create();

  /// Draws a frame into `framebuffer`, unless it would look like the last one. Returns whether it has drawn. Requires
  /// that the interface's frame has ended. While pictures follow each other, changes of the interface's windows wait
  /// for one of the next frames.
  [[nodiscard]] Result<bool> compose(const FrameParts& parts, Gui& gui, GLuint framebuffer);

  /// Returns how many seconds after the last frame another one would draw changes of the interface's windows that
  /// wait. None: nothing waits.
  [[nodiscard]] std::optional<double> waiting_seconds() const;

 private:
  [[nodiscard]] Status begin(const FrameParts& parts, bool top_first);
  [[nodiscard]] Status update_layer(Gui& gui);
  [[nodiscard]] Status take_picture(const FrameParts& parts);
  [[nodiscard]] Status draw(Gui& gui, GLuint framebuffer) const;
  void clear_layer(const PixelRect& part) const;
  void copy_columns(const ByteTarget& from, int from_left, int left, int right, GLuint framebuffer) const;
  void blend_layer() const;

  Program blend_;
  VertexArray vertex_array_;
  ByteTarget picture_, layer_;
  std::vector<std::uint32_t> pixels_;  // of the picture
  GuiLists overlays_;
  GuiWindows windows_;          // as the layer shows them
  int width_ = 0, height_ = 0;  // of the framebuffer
  PixelRect area_;              // of the picture
  bool top_first_ = false;      // the order of rows in picture and layer
  bool is_layer_lost_ = false;  // all of it is to be drawn
  bool is_layer_old_ = false;   // the windows have changed
  double layer_seconds_ = 0;    // since the windows were drawn
  double still_seconds_ = 0;    // since the picture was new
};

}  // namespace splatvol
