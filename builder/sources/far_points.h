// Points so far from all others that they are damage.
#pragma once

#include <cstdint>
#include <span>

#include "base/math.h"

namespace splatvol {

/// Sets the coordinates of a piece's far points to NaN, and returns their number. A point is far if it lies more than
/// 2^44 times as far from the middle of the points (the median along each axis) as nine tenths of them: Morton keys, of
/// 42 bits an axis, could not tell the others apart any more. Requires points that are usable (is_usable_position) or
/// will be dropped; these do not count. Pieces of fewer than 16 points have no far points.
std::uint64_t drop_far_points(std::span<dvec3> points);

}  // namespace splatvol
