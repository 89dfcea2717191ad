// How finely a picture is drawn.
#pragma once

#include <algorithm>

#include "renderer/rasterizer.h"
#include "scene/scene.h"
#include "streamer/splats/streamer.h"

namespace splatvol {

/// The most pixels from one sample to the next in a picture of a wanted error.
inline constexpr int widest_samples_of_an_error = 4;

/// Returns the pixels from one sample to the next, for Rasterizer::draw. A twelfth of the pixels that a splat may cover
/// loses next to nothing (docs/accuracy.md).
[[nodiscard]] inline int automatic_sample_spacing(const View& view, const Detail& detail) {
  if (detail.resolution || detail.goal) return 1;
  const double covered = detail.tolerance_percent / 100 * std::min(view.width, view.height);
  return std::clamp(static_cast<int>(std::min(covered, 1e6) / 12), 1, 6);
}

}  // namespace splatvol
