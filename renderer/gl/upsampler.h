// Samples farther apart than pixels, and the picture between them. Internal to the renderer.
#pragma once

#include "renderer/gl/gl_objects.h"
#include "renderer/gl/target.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns how many samples `pixels` along an axis need: one beyond each end at most, so that all lie between samples.
[[nodiscard]] constexpr int sample_count(int pixels, int spacing) { return (pixels + spacing - 1) / spacing + 2; }

/// Returns `view` with one sample for every `spacing` x `spacing` pixels. The middle of the picture stays the same
/// point.
[[nodiscard]] View sampled_view(View view, int spacing);

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
  Target rows_;                // as wide as the samples, as high as the picture
};

}  // namespace splatvol
