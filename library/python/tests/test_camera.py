import numpy as np
import pytest

from splatvol import _camera

CAMERA = {"projection": "perspective", "vertical_fov_degrees": 60, "position": [0, 0, 5], "focal_point": [0, 0, 0],
          "up": [0, 2, 0]}


def test_half_a_turn_over_the_height():
    turned = _camera.turn(CAMERA, .5, 0)
    # The front goes to the right: the camera goes to the left.
    np.testing.assert_allclose(turned["position"], [-5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(_camera.turn(CAMERA, 0, .5)["position"], [0, 5, 0], atol=1e-12)
    assert _camera.turn(CAMERA, 0, 0) == CAMERA
    for _ in range(100):
        turned = _camera.turn(turned, .01, -.03)
    assert _camera.distance(turned) == pytest.approx(5)


def test_dragging_and_zooming():
    assert _camera.height(CAMERA) == pytest.approx(10 * np.tan(np.radians(30)))
    dragged = _camera.drag(CAMERA, .1, 0)
    np.testing.assert_allclose(dragged["focal_point"], [-.1 * _camera.height(CAMERA), 0, 0], atol=1e-12)
    assert _camera.distance(_camera.zoom(CAMERA, .5)) == 2.5
    flat = {**CAMERA, "projection": "orthographic", "parallel_height": 3}
    assert _camera.zoom(flat, .5)["parallel_height"] == 1.5 and _camera.height(flat) == 3
