// Depths of another program's opaque surfaces.
#pragma once

#include <vector>

namespace splatvol {

/// Depths of opaque surfaces that hide what lies behind them. At each pixel's centre, the nearest surface in front of
/// the eye's plane: its distance from this plane, along the view's axis, in world units. Infinity or NaN: no surface.
/// 0 or less: the surface hides all that the pixel would show.
struct SurfaceDepths {
  int width = 0;
  int height = 0;
  std::vector<float> depths;  // [row][column], row 0 at the top
};

}  // namespace splatvol
