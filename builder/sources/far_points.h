// Points so far from all others that they are damage.
#pragma once

#include <cstdint>
#include <span>

#include "base/math.h"

namespace splatvol {

/// Usable points of a piece that are not far.
struct NearPoints {
  Box box;  // empty if there are none
  std::uint64_t dropped = 0;
};

/// Sets the coordinates of a piece's far points to NaN, and returns facts about the others. A point is far if it lies
/// more than 2^44 times as far from the middle of the points (the median along each axis) as nine tenths of them:
/// Morton keys, of 42 bits an axis, could not tell the others apart any more. Requires points that are usable
/// (is_usable_position) or will be dropped; these do not count. Pieces of fewer than 16 points have no far points.
NearPoints drop_far_points(std::span<dvec3> points);

}  // namespace splatvol
