// The framebuffer that splats are drawn into. Internal to the renderer.
#pragma once

#include <cstdint>

#include "renderer/gl/gl_objects.h"

namespace splatvol {

/// Returns the largest width or height of a Target.
[[nodiscard]] int largest_target_side();

/// A picture in linear premultiplied RGBA, 32-bit float, with a framebuffer.
class Target {
 public:
  /// Gives the picture this size in pixels, unless it has it already. Requires 1 to largest_target_side(). If it fails,
  /// there is no picture.
  [[nodiscard]] Status resize(int width, int height);

  /// Sets every pixel to 0.
  void clear() const;

  /// Directs drawing into the whole picture, without depth, stencil, culling or blending.
  void use() const;

  [[nodiscard]] GLuint texture() const { return color_.name(); }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::uint64_t bytes() const { return std::uint64_t{16} * width_ * height_; }

 private:
  Texture color_;
  Framebuffer framebuffer_;
  int width_ = 0;
  int height_ = 0;
};

}  // namespace splatvol
