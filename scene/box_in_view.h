// Where a box is in view.
#pragma once

#include <array>
#include <cstddef>

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns the eight corners of a box, in view coordinates.
[[nodiscard]] inline std::array<dvec3, 8> corners_in_view(const View& view, const Box& box) {
  std::array<dvec3, 8> corners;
  for (std::size_t i = 0; i < corners.size(); ++i)
    corners[i] = view.to_view({((i & 1) != 0 ? box.high : box.low).x, ((i & 2) != 0 ? box.high : box.low).y,
                               ((i & 4) != 0 ? box.high : box.low).z});
  return corners;
}

}  // namespace splatvol
