// Samples farther apart than pixels, and the picture between them. Internal to the renderer.
#pragma once

#include "renderer/gl_objects.h"
#include "renderer/target.h"
#include "scene/scene.h"

namespace splatvol {

/// How many samples it takes for `pixels` along an axis: up to one beyond each end, so that all lie between samples.
[[nodiscard]] constexpr int sample_count(int pixels, int spacing) { return (pixels + spacing - 1) / spacing + 2; }

/// `view` with a sample instead of every `spacing` x `spacing` pixels; both have their middle in the same place.
[[nodiscard]] View sampled_view(View view, int spacing);

/// Interpolates a picture by cubics, one axis after the other.
class Upsampler {
 public:
  /// Needs a current context.
  [[nodiscard]] static Result<Upsampler> create();

  /// Fills `picture` from samples of its sampled_view.
  [[nodiscard]] Status run(const Target& samples, int spacing, const Target& picture);

  /// Bytes of GPU memory held.
  [[nodiscard]] std::uint64_t bytes() const { return rows_.bytes(); }

 private:
  Upsampler(Program program, VertexArray no_attributes)
      : program_(std::move(program)), no_attributes_(std::move(no_attributes)) {}
  void pass(const Target& from, int axis, int spacing, const Target& to) const;

  Program program_;
  VertexArray no_attributes_;  // drawing takes one, be it empty
  Target rows_;                // as wide as the samples, as high as the picture
};

}  // namespace splatvol
