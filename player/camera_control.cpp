#include "player/camera_control.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace splatvol {
namespace {

double slope(const Camera& camera) { return std::tan(camera.vertical_fov_degrees * std::numbers::pi / 360); }

double distance(const Camera& camera) { return glm::length(camera.focal_point - camera.position); }

}  // namespace

CameraAxes axes_of(const Camera& camera) {
  const dvec3 forward = glm::normalize(camera.focal_point - camera.position);
  const dvec3 right = glm::normalize(glm::cross(forward, glm::normalize(camera.up)));
  return {right, glm::cross(right, forward), forward};
}

double world_per_pixel(const Camera& camera, const Viewport& viewport) {
  const bool orthographic = camera.projection == Camera::Projection::orthographic;
  return (orthographic ? camera.parallel_height : 2 * distance(camera) * slope(camera)) / viewport.height;
}

dvec3 focal_plane_point(const Camera& camera, const Viewport& viewport, const dvec2& pointer) {
  const CameraAxes axes = axes_of(camera);
  const double unit = world_per_pixel(camera, viewport);
  return camera.focal_point + unit * (pointer.x - viewport.width / 2) * axes.right +
         unit * (viewport.height / 2 - pointer.y) * axes.up;
}

void orbit(Camera& camera, const Viewport& viewport, const dvec2& drag) {
  const double length = glm::length(drag);
  if (!(length > 0)) return;
  const CameraAxes axes = axes_of(camera);
  const double angle = std::numbers::pi * length / std::min(viewport.width, viewport.height);
  const glm::dquat rotation = glm::angleAxis(angle, (-drag.x * axes.up - drag.y * axes.right) / length);
  camera.position = camera.focal_point + rotation * (camera.position - camera.focal_point);
  camera.up = glm::normalize(rotation * axes.up);
}

void roll(Camera& camera, double angle) {
  const CameraAxes axes = axes_of(camera);
  camera.up = std::cos(angle) * axes.up + std::sin(angle) * axes.right;
}

void pan(Camera& camera, const Viewport& viewport, const dvec2& drag) {
  const CameraAxes axes = axes_of(camera);
  const dvec3 move = world_per_pixel(camera, viewport) * (-drag.x * axes.right + drag.y * axes.up);
  camera.position += move;
  camera.focal_point += move;
}

void zoom(Camera& camera, const Viewport& viewport, const dvec2& pointer, double factor, double least_distance) {
  const bool orthographic = camera.projection == Camera::Projection::orthographic;
  const double now = orthographic ? camera.parallel_height : distance(camera);
  factor = std::max(factor, std::min(1.0, least_distance / now));
  const dvec3 kept = focal_plane_point(camera, viewport, pointer);
  const dvec3 move = (1 - factor) * (kept - camera.focal_point);
  const dvec3 from_focal_point = camera.position - camera.focal_point;
  camera.focal_point += move;
  if (orthographic) {
    camera.parallel_height *= factor;
    camera.position += move;
  } else {
    camera.position = camera.focal_point + factor * from_focal_point;
  }
}

void fly(Camera& camera, const dvec3& move, double yaw, double pitch) {
  const CameraAxes axes = axes_of(camera);
  const dvec3 moved = move.x * axes.right + move.y * axes.up + move.z * axes.forward;
  const glm::dquat turn = glm::angleAxis(-yaw, axes.up) * glm::angleAxis(pitch, axes.right);
  const double length = distance(camera);
  camera.position += moved;
  camera.focal_point = camera.position + length * (turn * axes.forward);
  camera.up = glm::normalize(turn * axes.up);
}

void look_along(Camera& camera, const dvec3& direction, const dvec3& up) {
  camera.position = camera.focal_point - distance(camera) * glm::normalize(direction);
  camera.up = up;
}

void set_projection(Camera& camera, Camera::Projection projection) {
  if (camera.projection == projection) return;
  if (projection == Camera::Projection::orthographic) {
    camera.parallel_height = 2 * distance(camera) * slope(camera);
  } else {
    const dvec3 backwards = glm::normalize(camera.position - camera.focal_point);
    camera.position = camera.focal_point + camera.parallel_height / (2 * slope(camera)) * backwards;
  }
  camera.projection = projection;
}

}  // namespace splatvol
