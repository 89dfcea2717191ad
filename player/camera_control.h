// Moves a camera as a hand asks for it. Pure geometry: no window, no time.
#pragma once

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// The size of the picture under the pointer, in the units of the pointer's coordinates. They count from the upper left
/// corner, y downwards.
struct Viewport {
  double width = 1;
  double height = 1;
};

/// The camera's axes; `up` is perpendicular to the line of sight. axes_of requires a camera that make_view takes.
struct CameraAxes {
  dvec3 right, up, forward;
};
[[nodiscard]] CameraAxes axes_of(const Camera& camera);

/// Returns the world units that a unit of the viewport covers at the focal point.
[[nodiscard]] double world_per_pixel(const Camera& camera, const Viewport& viewport);

/// Returns the point under the pointer on the focal plane: the plane through the focal point that faces the camera.
[[nodiscard]] dvec3 focal_plane_point(const Camera& camera, const Viewport& viewport, const dvec2& pointer);

/// Turns the camera about the focal point, as if the pointer dragged a ball there: half a turn over the shorter side.
/// Up turns along, so there are no poles.
void orbit(Camera& camera, const Viewport& viewport, const dvec2& drag);

/// Turns the picture about the line of sight; radians, counterclockwise.
void roll(Camera& camera, double angle);

/// Moves the camera so that the focal plane follows the pointer.
void pan(Camera& camera, const Viewport& viewport, const dvec2& drag);

/// Scales distances by `factor` towards the point under the pointer on the focal plane, which keeps its position on the
/// screen. The distance of the focal point (orthographic: the image's height) does not shrink below `least_distance`.
void zoom(Camera& camera, const Viewport& viewport, const dvec2& pointer, double factor, double least_distance);

/// Moves eye and focal point by `move` along right, up and forward, in world units. Turns the line of sight about the
/// eye by `yaw` to the right and `pitch` upwards, in radians.
void fly(Camera& camera, const dvec3& move, double yaw, double pitch);

/// Looks along `direction` at the focal point, from an unchanged distance. `up` must not be parallel to `direction`.
void look_along(Camera& camera, const dvec3& direction, const dvec3& up);

/// Changes the projection. Things at the focal point keep their size.
void set_projection(Camera& camera, Camera::Projection projection);

}  // namespace splatvol
