// Straight lines over pictures.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "pictures/outline.h"

namespace splatvol {

/// Calls `draw(x, y, share)` for the pixels that a line of this width covers.
template <class Draw>
void visit_line(const ProjectedSegment& segment, double width, int columns, int rows, const Draw& draw) {
  const dvec2 along = segment.to - segment.from;
  const double length = glm::length(along);
  if (!(length > 0)) return;
  const int major = std::abs(along.x) >= std::abs(along.y) ? 0 : 1, minor = 1 - major;
  const int most = major == 0 ? columns : rows, most_minor = major == 0 ? rows : columns;
  const double slope = along[minor] / along[major];
  const double low = std::min(segment.from[major], segment.to[major]);
  const double high = std::max(segment.from[major], segment.to[major]);
  const double reach = (0.5 * width + 1) * length / std::abs(along[major]);
  for (int i = static_cast<int>(std::clamp(std::floor(low), 0.0, double(most))); i < most && i <= high; ++i) {
    const double center = segment.from[minor] + slope * (i + 0.5 - segment.from[major]);
    if (!(center + reach >= 0 && center - reach <= most_minor)) continue;
    const int first = std::max(0, static_cast<int>(std::floor(center - reach)));
    const int last = std::min(most_minor - 1, static_cast<int>(std::floor(center + reach)));
    for (int j = first; j <= last; ++j) {
      const double distance = std::abs(j + 0.5 - center) * std::abs(along[major]) / length;
      const double share = std::clamp(0.5 * width + 0.5 - distance, 0.0, 1.0);
      if (share > 0) major == 0 ? draw(i, j, share) : draw(j, i, share);
    }
  }
}

}  // namespace splatvol
