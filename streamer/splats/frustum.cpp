#include "streamer/splats/frustum.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

// Returns the distance of a cube's centre from a plane, and half of the cube's extent across the plane.
struct AcrossPlane {
  double center, half;
};
AcrossPlane across(const Plane& plane, const Cube& cube) {
  const double half = 0.5 * cube.edge;
  return {plane.distance(cube.origin + half), half * glm::dot(glm::abs(plane.normal), dvec3(1))};
}

}  // namespace

bool lies_inside(const Cube& cube, const Plane& plane) {
  const AcrossPlane at = across(plane, cube);
  return at.center >= at.half;
}

bool is_clipped(const Cube& cube, const ClipRegion& clip) {
  if (clip.box && !(glm::all(glm::greaterThanEqual(cube.origin, clip.box->low)) &&
                    glm::all(glm::lessThanEqual(cube.origin + cube.edge, clip.box->high))))
    return true;
  return !std::ranges::all_of(clip.planes, [&](const Plane& plane) { return lies_inside(cube, plane); });
}

bool meets(const Cube& cube, double reach, const Plane& plane) {
  const AcrossPlane at = across(plane, cube);
  return std::abs(at.center) <= at.half + reach;
}

Frustum::Frustum(const View& view, double smallest_reach_pixels) : view_(view) {
  // In perspective the sides pass through the eye: |x| f <= z width / 2. With parallel rays they have a constant
  // distance from it.
  const auto side = [&](const dvec3& inwards, int pixels) -> Side {
    const double half = 0.5 * pixels + smallest_reach_pixels;
    if (view.orthographic) return {inwards, half / view.focal};
    return {glm::normalize(view.focal * inwards + half * view.forward), 0};
  };
  sides_ = {side(view.right, view.width), side(-view.right, view.width), side(view.up, view.height),
            side(-view.up, view.height), Side{view.forward, 0}};
}

double Frustum::farthest(const Side& side, const Cube& cube) const {
  const double half = 0.5 * cube.edge;
  const dvec3 center = cube.origin + half - view_.eye;
  return side.offset + glm::dot(side.normal, center) + half * glm::dot(glm::abs(side.normal), dvec3(1));
}

bool Frustum::touches(const Cube& cube, double reach) const {
  if (const auto& box = view_.clip.box) {
    const dvec3 low = cube.origin - reach, high = cube.origin + (cube.edge + reach);
    if (!glm::all(glm::lessThan(low, box->high)) || !glm::all(glm::greaterThan(high, box->low))) return false;
  }
  for (const Plane& plane : view_.clip.planes) {
    const AcrossPlane at = across(plane, cube);
    if (!(at.center + at.half + reach > 0)) return false;
  }
  return std::ranges::all_of(sides_, [&](const Side& side) { return farthest(side, cube) + reach > 0; });
}

bool Frustum::touches(const Box& box) const {
  if (view_.clip.excludes(box)) return false;
  const dvec3 low = box.low - view_.eye, high = box.high - view_.eye;
  return std::ranges::all_of(sides_, [&](const Side& side) {
    const dvec3 farthest = glm::max(side.normal * low, side.normal * high);
    return side.offset + farthest.x + farthest.y + farthest.z >= 0;
  });
}

double Frustum::nearest_depth(const Cube& cube) const { return -farthest({-view_.forward, 0}, cube); }

double Frustum::covered_percent(double length, double depth) const {
  const double pixels_per_length = view_.orthographic ? view_.focal
                                   : depth > 0        ? view_.focal / depth
                                                      : std::numeric_limits<double>::infinity();
  return 100 * length * pixels_per_length / std::min(view_.width, view_.height);
}

}  // namespace splatvol
