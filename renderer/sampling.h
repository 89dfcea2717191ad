// How far samples of a picture may lie apart.
#pragma once

#include <algorithm>

#include "scene/scene.h"
#include "streamer/streamer.h"

namespace splatvol {

/// Pixels between samples, for Renderer::draw: a twelfth of what a splat may cover loses next to nothing
/// (docs/accuracy.md).
[[nodiscard]] inline int automatic_sample_spacing(const View& view, const DetailOptions& detail) {
  if (detail.resolution || detail.goal) return 1;
  const double covered = detail.tolerance_percent / 100 * std::min(view.width, view.height);
  return std::clamp(static_cast<int>(std::min(covered, 1e6) / 12), 1, 6);
}

}  // namespace splatvol
