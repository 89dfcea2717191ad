// Views with fewer samples than pixels.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Returns `view` with one sample for every `spacing` x `spacing` pixels, and one beyond each end at most, so that all
/// pixels lie between samples. The middle of the picture stays the same point.
[[nodiscard]] inline View sampled_view(View view, int spacing) {
  if (spacing == 1) return view;
  const auto count = [spacing](int pixels) { return (pixels + spacing - 1) / spacing + 2; };
  view.width = count(view.width);
  view.height = count(view.height);
  view.focal /= spacing;
  return view;
}

}  // namespace splatvol
