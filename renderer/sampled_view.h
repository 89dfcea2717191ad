// Views with fewer samples than pixels.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Returns how many samples `spacing` pixels apart an axis of so many pixels has: the first and the last one lie beyond
/// its ends, all others at or between pixels.
[[nodiscard]] constexpr int sample_count(int pixels, int spacing) { return (pixels + spacing - 1) / spacing + 2; }

/// Returns `view` with one sample for every `spacing` x `spacing` pixels, and one beyond each end at most, so that all
/// pixels lie between samples. The middle of the picture stays the same point.
[[nodiscard]] inline View sampled_view(View view, int spacing) {
  if (spacing == 1) return view;
  view.width = sample_count(view.width, spacing);
  view.height = sample_count(view.height, spacing);
  view.focal /= spacing;
  return view;
}

}  // namespace splatvol
