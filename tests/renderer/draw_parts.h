// Draw lists from a test's splats.
#pragma once

#include <span>
#include <vector>

#include "splat/record.h"

namespace splatvol::test {

/// Consecutive splats that are drawn with one origin and one weight.
struct DrawPart {
  dvec3 origin;
  std::size_t first, count;
  float weight = 1;
};

/// Packs a row for each part. Splats are MomentsSplat or OctantSplat, in world units.
template <class Splat>
DrawList make_list(const std::vector<Splat>& splats, const std::vector<DrawPart>& parts) {
  DrawList list;
  for (const DrawPart& part : parts)
    append(list, pack_row(std::span(splats).subspan(part.first, part.count), part.origin, 1), 0,
           static_cast<std::uint32_t>(part.count), part.weight);
  return list;
}

/// Gives the ranges of `make_list` the weights of other parts.
inline void set_weights(DrawList& list, const std::vector<DrawPart>& parts) {
  std::size_t range = 0;
  for (const DrawPart& part : parts)
    for (std::size_t count = 0; count < part.count; ++range) {
      list.ranges[range].weight = part.weight;
      count += list.ranges[range].count;
    }
}

}  // namespace splatvol::test
