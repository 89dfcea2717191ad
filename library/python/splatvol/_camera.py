"""Cameras of scenes, moved by a pointer. Lengths of the pointer are shares of the picture's height."""

from __future__ import annotations

from typing import Any, Dict, Tuple

import numpy as np
from numpy.typing import NDArray

Camera = Dict[str, Any]
Vector = NDArray[np.float64]


def _vector(camera: Camera, name: str) -> Vector:
    return np.asarray(camera[name], np.float64)


def _is_orthographic(camera: Camera) -> bool:
    return bool(camera.get("projection") == "orthographic")


def distance(camera: Camera) -> float:
    """Returns the distance to the focal point, in world units."""
    return float(np.linalg.norm(_vector(camera, "focal_point") - _vector(camera, "position")))


def axes(camera: Camera) -> Tuple[Vector, Vector, Vector]:
    """Returns the directions to the right, upwards and forwards, of length 1."""
    forward = _vector(camera, "focal_point") - _vector(camera, "position")
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, _vector(camera, "up"))
    right = right / np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def height(camera: Camera) -> float:
    """Returns the world units from the lower to the upper edge, at the focal point."""
    if _is_orthographic(camera):
        return float(camera["parallel_height"])
    return 2 * distance(camera) * float(np.tan(np.radians(camera["vertical_fov_degrees"]) / 2))


def turn(camera: Camera, dx: float, dy: float) -> Camera:
    """Turns the camera about the focal point, as if the pointer dragged a ball there: half a turn over the height.

    ``dx`` to the right, ``dy`` downwards. Up turns along, so there are no poles.
    """
    length = float(np.hypot(dx, dy))
    if length == 0:
        return camera
    right, up, _ = axes(camera)
    axis = (-dx * up - dy * right) / length
    angle = np.pi * length

    def turned(v: Vector) -> Vector:
        return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + axis * (axis @ v) * (1 - np.cos(angle))

    center = _vector(camera, "focal_point")
    position = center + turned(_vector(camera, "position") - center)
    return {**camera, "position": position.tolist(), "up": turned(up).tolist()}


def drag(camera: Camera, dx: float, dy: float) -> Camera:
    """Moves the camera so that what is at the focal point follows the pointer."""
    right, up, _ = axes(camera)
    move = height(camera) * (dy * up - dx * right)
    return {
        **camera,
        "position": (_vector(camera, "position") + move).tolist(),
        "focal_point": (_vector(camera, "focal_point") + move).tolist(),
    }


def zoom(camera: Camera, factor: float) -> Camera:
    """Multiplies the distance to the focal point, or the height of an orthographic picture."""
    if _is_orthographic(camera):
        return {**camera, "parallel_height": camera["parallel_height"] * factor}
    center = _vector(camera, "focal_point")
    return {**camera, "position": (center + factor * (_vector(camera, "position") - center)).tolist()}
