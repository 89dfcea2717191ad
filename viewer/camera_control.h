// What a hand does to a camera. Pure geometry: no window, no time.
#pragma once

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// The size of the picture that the pointer moves over, in the units of its coordinates (from the upper left corner, y
/// downwards).
struct Viewport {
  double width = 1;
  double height = 1;
};

/// The camera's axes; `up` is perpendicular to the line of sight. Requires a camera that make_view takes.
struct CameraAxes {
  dvec3 right, up, forward;
};
[[nodiscard]] CameraAxes axes_of(const Camera& camera);

/// World units that a unit of the viewport covers at the focal point.
[[nodiscard]] double world_per_pixel(const Camera& camera, const Viewport& viewport);

/// The point under the pointer on the plane through the focal point that faces the camera.
[[nodiscard]] dvec3 focal_plane_point(const Camera& camera, const Viewport& viewport, const dvec2& pointer);

/// Turns the camera about the focal point, as if the pointer dragged a ball there: half a turn over the shorter side.
/// Has no poles: up turns along.
void orbit(Camera& camera, const Viewport& viewport, const dvec2& drag);

/// Turns the picture about the line of sight; radians, counterclockwise.
void roll(Camera& camera, double angle);

/// Moves the camera so that the focal point's plane follows the pointer.
void pan(Camera& camera, const Viewport& viewport, const dvec2& drag);

/// Shrinks distances by `factor` towards the point under the pointer on the focal plane, which stays where it is seen.
/// The focal point keeps a distance of at least `least_distance` (orthographic: the image that height).
void zoom(Camera& camera, const Viewport& viewport, const dvec2& pointer, double factor, double least_distance);

/// Moves eye and focal point by `move` along right, up and forward, in world units, and turns the line of sight about
/// the eye; radians to the right and upwards.
void fly(Camera& camera, const dvec3& move, double yaw, double pitch);

/// Looks along `direction` at the focal point, from the distance that it has; `up` must not be parallel to it.
void look_along(Camera& camera, const dvec3& direction, const dvec3& up);

/// Changes the projection; what lies at the focal point keeps its size.
void set_projection(Camera& camera, Camera::Projection projection);

}  // namespace splatvol
