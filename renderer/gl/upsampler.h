// The picture between samples that are farther apart than pixels. Internal to the renderer.
#pragma once

#include "renderer/gl/gl_objects.h"
#include "renderer/gl/target.h"

namespace splatvol {

/// Interpolates a picture by cubics that do not overshoot, one axis after the other.
class Upsampler {
 public:
  /// Needs a current context.
  [[nodiscard]] static Result<Upsampler> create();

  /// Fills `picture` from `samples`, a picture of its sampled_view.
  [[nodiscard]] Status run(const Target& samples, int spacing, const Target& picture);

  /// Returns the bytes of GPU memory held.
  [[nodiscard]] std::uint64_t bytes() const { return rows_.bytes(); }

 private:
  Upsampler(Program program, VertexArray no_attributes)
      : program_(std::move(program)), no_attributes_(std::move(no_attributes)) {}
  void pass(const Target& from, int axis, int spacing, const Target& to) const;

  Program program_;
  VertexArray no_attributes_;  // empty, but OpenGL does not draw without one
  Target rows_;                // as wide as the picture, as high as the samples
};

}  // namespace splatvol
