// What is drawn into. Internal to the renderer.
#pragma once

#include <cstdint>

#include "renderer/gl_objects.h"

namespace splatvol {

/// A picture in linear premultiplied RGBA, 32-bit float, with a framebuffer.
class Target {
 public:
  /// Makes it so large, in pixels, unless it is already. Fails where the device does not draw so large a picture; there
  /// is none then.
  [[nodiscard]] Status resize(int width, int height);

  /// Sets every pixel to 0.
  void clear() const;

  /// Makes it what is drawn into, all of it, without depth, stencil, culling or blending.
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
