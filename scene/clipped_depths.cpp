#include "scene/clipped_depths.h"

#include <algorithm>
#include <limits>

namespace splatvol {

VisibleDepths clipped_depths(const View& view, double a, double b) {
  VisibleDepths range{0, std::numeric_limits<double>::infinity()};
  const dvec3 aside = a * view.right + b * view.up;
  const dvec3 origin = view.orthographic ? view.eye + aside : view.eye;
  const dvec3 along = view.orthographic ? view.forward : view.forward + aside;
  for (const Plane& plane : view.clip.planes) {
    const double distance = plane.distance(origin), rise = glm::dot(plane.normal, along);
    if (rise > 0)
      range.from = std::max(range.from, -distance / rise);
    else if (rise < 0)
      range.to = std::min(range.to, -distance / rise);
    else if (distance < 0)
      range.to = 0;
  }
  for (int axis = 0; axis < 3 && view.clip.box; ++axis) {
    const double low = view.clip.box->low[axis] - origin[axis], high = view.clip.box->high[axis] - origin[axis];
    if (along[axis] == 0) {
      if (low > 0 || high < 0) range.to = 0;
      continue;
    }
    const auto [first, last] = std::minmax({low / along[axis], high / along[axis]});
    range.from = std::max(range.from, first);
    range.to = std::min(range.to, last);
  }
  return range;
}

}  // namespace splatvol
