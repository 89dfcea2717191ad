// Edits of a transfer function by a hand: its control points, axis and domain.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

/// Adds a control point, behind those of the same t. Returns its index.
template <class Point>
std::size_t add_point(std::vector<Point>& points, const Point& added) {
  const auto place = std::ranges::upper_bound(points, added.t, {}, &Point::t) - points.begin();
  points.insert(points.begin() + place, added);
  return static_cast<std::size_t>(place);
}

/// Removes a control point, unless it is the only one.
template <class Point>
void remove_point(std::vector<Point>& points, std::size_t index) {
  if (points.size() > 1) points.erase(points.begin() + static_cast<std::ptrdiff_t>(index));
}

/// Moves a control point to `t`, but not past its neighbours or out of [0, 1].
template <class Point>
void move_point(std::vector<Point>& points, std::size_t index, double t) {
  const double from = index > 0 ? points[index - 1].t : 0, to = index + 1 < points.size() ? points[index + 1].t : 1;
  points[index].t = std::clamp(t, from, std::max(from, to));
}

/// Returns the largest extinction of the control points.
[[nodiscard]] double largest_extinction(const TransferFunction& function);

/// Returns the function on another axis and domain; control points keep their t. A logarithmic axis begins at a
/// millionth of `hi` if `lo` is not above 0. The function stays as it is if `hi` is not above 0 either. The asinh axis
/// is linear up to a thousandth of the largest value if the axis before was another.
[[nodiscard]] TransferFunction with_domain(TransferFunction function, ValueAxis axis, double lo, double hi);

}  // namespace splatvol
