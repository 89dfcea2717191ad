// Pictures of bytes, as windows have them.
#pragma once

#include <cstdint>
#include <span>

#include "base/error.h"
#include "renderer/gl/gl_objects.h"

namespace splatvol {

/// A picture of blue, green, red and alpha bytes, with a framebuffer. Mesa's drivers give windows the same layout.
/// Where the processor draws for OpenGL, a copy between equal layouts is one of memory: a tenth of the time. Needs the
/// context of its first `resize` in each call.
class ByteTarget {
 public:
  /// Gives the picture this size, unless it has it. Then its pixels are undefined. Requires sides of 1 or more.
  [[nodiscard]] Status resize(int width, int height);

  /// Replaces the picture: pixels with blue in the lowest byte, the framebuffer's first row first. Requires as many as
  /// the picture has.
  [[nodiscard]] Status write(std::span<const std::uint32_t> pixels);

  /// Directs drawing into the whole picture, without depth, culling or blending.
  void use() const;

  [[nodiscard]] GLuint texture() const { return texture_.name(); }
  [[nodiscard]] GLuint framebuffer() const { return framebuffer_.name(); }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

 private:
  Texture texture_;
  Framebuffer framebuffer_;
  int width_ = 0, height_ = 0;
};

}  // namespace splatvol
