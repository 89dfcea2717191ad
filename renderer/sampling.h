// How finely a picture is drawn.
#pragma once

#include <algorithm>
#include <cstdint>

#include "renderer/rasterizer.h"
#include "scene/scene.h"
#include "streamer/streamer.h"

namespace splatvol {

/// Returns whether splats are to be mixed in slabs if the rasterizer can. Many splats a pixel are so small that they
/// make no ripple, and slabs of them would take minutes.
[[nodiscard]] inline bool is_worth_mixing(const View& view, std::uint64_t splats) {
  constexpr std::uint64_t most_a_pixel = 8;
  return splats <= most_a_pixel * static_cast<std::uint64_t>(view.width) * static_cast<std::uint64_t>(view.height);
}

/// Returns the pixels from one sample to the next, for Rasterizer::draw. A twelfth of the pixels that a splat may cover
/// loses next to nothing (docs/accuracy.md). Slabs have wider samples of their own for large splats.
[[nodiscard]] inline int automatic_sample_spacing(const View& view, const DetailOptions& detail,
                                                  Compositing compositing) {
  if (detail.resolution || detail.goal || compositing == Compositing::slabs) return 1;
  const double covered = detail.tolerance_percent / 100 * std::min(view.width, view.height);
  return std::clamp(static_cast<int>(std::min(covered, 1e6) / 12), 1, 6);
}

}  // namespace splatvol
