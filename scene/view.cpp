#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene/clipped_depths.h"
#include "scene/scene.h"

namespace splatvol {
namespace {

/// Sine of the smallest angle between up and the line of sight that still gives axes.
constexpr double smallest_tilt = 1e-9;

bool is_finite(dvec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace

// Components near 1 have squares that neither overflow nor vanish.
Plane make_plane(const dvec3& point, const dvec3& normal) {
  const dvec3 size = glm::abs(normal);
  return {point, glm::normalize(normal / std::max({size.x, size.y, size.z}))};
}

bool ClipRegion::contains(const dvec3& position, double margin) const {
  if (box && (glm::any(glm::lessThan(position, box->low - margin)) ||
              glm::any(glm::greaterThan(position, box->high + margin))))
    return false;
  return std::ranges::all_of(planes, [&](const Plane& plane) { return plane.distance(position) >= -margin; });
}

bool ClipRegion::excludes(const Box& other) const {
  if (box && (glm::any(glm::greaterThan(box->low, other.high)) || glm::any(glm::lessThan(box->high, other.low))))
    return true;
  const dvec3 center = 0.5 * (other.low + other.high), half = 0.5 * other.extent();
  return std::ranges::any_of(
      planes, [&](const Plane& plane) { return plane.distance(center) + glm::dot(glm::abs(plane.normal), half) < 0; });
}

unsigned nearest_octant(const View& view, const Cube& node) {
  const dvec3 towards_eye = view.orthographic ? -view.forward : view.eye - (node.origin + 0.5 * node.edge);
  return (towards_eye.x > 0 ? 1u : 0u) | (towards_eye.y > 0 ? 2u : 0u) | (towards_eye.z > 0 ? 4u : 0u);
}

Result<View> make_view(const Camera& camera, int width, int height) {
  if (width < 1 || height < 1) return fail(ErrorCode::invalid_argument, "image: {} x {} pixels", width, height);

  const dvec3 sight = camera.focal_point - camera.position;
  const double distance = glm::length(sight);
  if (!std::isfinite(distance))
    return fail(ErrorCode::invalid_argument, "camera.focal_point: too far from the position");
  if (distance == 0) return fail(ErrorCode::invalid_argument, "camera.focal_point: equals the position");
  if (!is_finite(camera.up) || glm::length(camera.up) == 0)
    return fail(ErrorCode::invalid_argument, "camera.up: has no direction");

  View view;
  view.eye = camera.position;
  view.forward = sight / distance;
  const dvec3 across = glm::cross(view.forward, glm::normalize(camera.up));
  if (!(glm::length(across) > smallest_tilt))
    return fail(ErrorCode::invalid_argument, "camera.up: lies along the line of sight");
  view.right = glm::normalize(across);
  view.up = glm::cross(view.right, view.forward);

  view.orthographic = camera.projection == Camera::Projection::orthographic;
  const double half_angle = camera.vertical_fov_degrees * std::numbers::pi / 360;
  view.focal = view.orthographic ? height / camera.parallel_height : 0.5 * height / std::tan(half_angle);
  if (!std::isfinite(view.focal) || view.focal <= 0)
    return fail(ErrorCode::invalid_argument, "camera: the field of view is empty");
  view.width = width;
  view.height = height;
  return view;
}

Result<View> make_view(const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(view, make_view(scene.camera, scene.width, scene.height));
  view.clip = clip_region_of(scene);
  for (const SceneSlice& slice : scene.slices)
    if (slice.shown && slice.opacity > 0)
      view.slices.push_back({make_plane(slice.point, slice.normal), std::min(slice.opacity, 1.0)});
  if (view.slices.size() > most_slices)
    return fail(ErrorCode::invalid_argument, "{} slices; at most {} are drawn", view.slices.size(), most_slices);
  SPLATVOL_TRY(check_contours(scene.contours));
  return view;
}

}  // namespace splatvol
