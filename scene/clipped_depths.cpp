#include "scene/clipped_depths.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {

ClipRegion clip_region_of(const Scene& scene) {
  ClipRegion clip{scene.clip_box, {}};
  for (const SceneClipPlane& plane : scene.clip_planes)
    if (plane.active) clip.planes.push_back(make_plane(plane.point, plane.normal));
  return clip;
}

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

bool is_clipped(const View& view, double a, double b, double depth) {
  if (view.clip.is_all()) return false;
  const double w = view.orthographic ? 1 : depth;
  const dvec3 position = view.eye + a * w * view.right + b * w * view.up + depth * view.forward;
  double size = std::abs(depth) + 1e-6 * glm::length(view.eye);
  if (view.clip.box) size += glm::length(view.clip.box->extent());
  return !view.clip.contains(position, 1e-9 * size);
}

PlaneDepths::PlaneDepths(const View& view, const Plane& plane)
    : view_(view),
      normal_(glm::dot(plane.normal, view.right), glm::dot(plane.normal, view.up),
              glm::dot(plane.normal, view.forward)),
      distance_(-plane.distance(view.eye)) {}

double PlaneDepths::at(double a, double b) const {
  constexpr double largest = std::numeric_limits<float>::max();
  const double depth = view_.orthographic ? (distance_ - a * normal_.x - b * normal_.y) / normal_.z
                                          : distance_ / (a * normal_.x + b * normal_.y + normal_.z);
  return depth > 0 && depth < largest && !is_clipped(view_, a, b, depth) ? depth
                                                                         : std::numeric_limits<double>::infinity();
}

}  // namespace splatvol
