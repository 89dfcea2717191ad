// Draw lists from a test's splats.
#pragma once

#include <span>
#include <vector>

#include "splat/record.h"

namespace splatvol::test {

/// Consecutive splats that are drawn with one origin.
struct DrawPart {
  dvec3 origin;
  std::size_t first, count;
};

/// Packs a row for each part. Splats are MomentsSplat or OctantSplat, in world units.
template <class Splat>
DrawList make_list(const std::vector<Splat>& splats, const std::vector<DrawPart>& parts) {
  DrawList list;
  for (const DrawPart& part : parts)
    append(list, pack_row(std::span(splats).subspan(part.first, part.count), part.origin, 1), 0,
           static_cast<std::uint32_t>(part.count));
  return list;
}

}  // namespace splatvol::test
