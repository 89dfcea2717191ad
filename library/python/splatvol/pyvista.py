"""Together with PyVista: points of a file as its data sets, and pictures among its surfaces."""

from __future__ import annotations

from typing import Any, Dict, Optional, Sequence, Tuple

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkImageMapper, vtkWindowToImageFilter

from ._arguments import refuse_unknown
from ._files import File, open
from ._pictures import to_srgb8
from ._renderers import MOVING_QUALITY, Quality
from ._scenes import Scene, SceneLike, read_scene
from .errors import UnsupportedError


def read(
    path: str,
    resolution: Optional[int] = None,
    max_points: int = 1_000_000,
    attributes: Optional[Sequence[str]] = None,
    box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
    step: Optional[int] = None,
) -> pv.PolyData:
    """Reads points of a .svol file, by its path or address. ``pyvista.read`` calls it, with the same options.

    ``step``: of a time series; None: the last. Other arguments as for ``File.points``: without a resolution, the finest
    of up to ``max_points`` points. Each attribute is an array of points; the field data has the ``resolution``.
    """
    file = open(path)
    if step is not None:
        file.show_step(step)
    points = file.points(resolution, max_points, box, attributes)
    mesh = pv.PolyData(points.positions)
    for name, values in points.values.items():
        mesh.point_data[name] = values
    mesh.field_data["resolution"] = [points.resolution]
    return mesh


def camera_of(plotter: pv.BasePlotter) -> Dict[str, Any]:
    """Returns the plotter's camera as that of a scene.

    Raises ``UnsupportedError`` for a camera with a shifted or sheared picture.
    """
    camera = plotter.camera
    if camera.GetWindowCenter() != (0, 0) or camera.GetUseOffAxisProjection() or camera.GetUseHorizontalViewAngle():
        raise UnsupportedError("the plotter's camera is shifted, off its axis, or has a horizontal angle of view")
    vectors = {
        "position": [float(x) for x in camera.position],
        "focal_point": [float(x) for x in camera.focal_point],
        "up": [float(x) for x in camera.up],
    }
    if camera.parallel_projection:
        return {"projection": "orthographic", "parallel_height": 2 * camera.parallel_scale, **vectors}
    return {"projection": "perspective", "vertical_fov_degrees": camera.view_angle, **vectors}


def depths_of(plotter: pv.BasePlotter) -> NDArray[np.float32]:
    """Returns the depths of the plotter's surfaces, for ``File.render``: (height, width), NaN where there is none."""
    plotter.renderer.ResetCameraClippingRange()
    grab = vtkWindowToImageFilter()
    grab.SetInput(plotter.render_window)
    grab.SetScale(plotter.image_scale)
    grab.ReadFrontBufferOff()
    grab.SetInputBufferTypeToZBuffer()
    grab.Update()
    width, height, _ = grab.GetOutput().GetDimensions()
    z = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars()).reshape(height, width)[::-1].astype(np.float64)

    near, far = plotter.camera.GetClippingRange()
    is_parallel = plotter.camera.GetParallelProjection()
    depths = near + z * (far - near) if is_parallel else near * far / (far - z * (far - near))
    return np.where(z < 1, depths, np.nan).astype(np.float32)


def composite(
    plotter: pv.BasePlotter, file: File, scene: Optional[SceneLike] = None, **quality: Any
) -> NDArray[np.uint8]:
    """Returns the plotter's picture with the volume in it: (height, width, 3), uint8, sRGB.

    The volume is drawn with the plotter's camera; surfaces hide what lies behind them, exactly, and what lies in front
    of them covers them. ``scene``: its transfer function, attribute, lighting and clip box are taken; None: those that
    fit the data. ``quality``: as for ``File.render``. Translucent surfaces count as opaque.

    The plotter must have been shown (``show(auto_close=False)``) or rendered. Raises ``UnsupportedError`` if it has
    several parts.
    """
    return _Compositor(file, scene).picture(plotter, **quality)


class _Compositor:
    """Draws a file into pictures of a plotter."""

    def __init__(self, file: File, scene: Optional[SceneLike]) -> None:
        self._file = file
        self._scene: Scene = file.scene() if scene is None else read_scene(scene)

    def picture(self, plotter: pv.BasePlotter, **quality: Any) -> NDArray[np.uint8]:
        if len(plotter.renderers) != 1:
            raise UnsupportedError("the plotter has several parts: take one with shape=(1, 1)")
        depths = depths_of(plotter)
        behind = np.asarray(plotter.screenshot(return_img=True, transparent_background=False))[..., :3]
        height, width = depths.shape
        scene = {**self._scene, "camera": camera_of(plotter)}
        volume = self._file.render(scene, (width, height), depths=depths, **quality)
        return to_srgb8(_over(volume, behind))


def _over(volume: NDArray[np.float32], behind: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Puts a picture over one of 8 bits, in linear light."""
    srgb = behind / np.float32(255)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    result = np.ones_like(volume)
    result[..., :3] = volume[..., :3] + (1 - volume[..., 3:]) * linear
    return result


class VolumeOverlay:
    """A volume that covers the window of a plotter, and follows its camera: see ``add_volume``."""

    def __init__(
        self, plotter: pv.BasePlotter, file: File, scene: Optional[SceneLike], quality: Dict[str, Any]
    ) -> None:
        self._plotter = plotter
        self._compositor = _Compositor(file, scene)
        self._quality = quality
        self._mapper = vtkImageMapper()
        self._mapper.SetColorWindow(255)
        self._mapper.SetColorLevel(127.5)
        self._actor = vtkActor2D()
        self._actor.SetMapper(self._mapper)
        self._actor.VisibilityOff()
        plotter.renderer.AddViewProp(self._actor)
        self._is_drawing = self._is_removed = False
        self._drawn: Optional[Tuple[Any, ...]] = None  # what the picture depends on
        plotter.add_on_render_callback(self._follow)
        self._observers: list[int] = []
        interactor = getattr(plotter, "iren", None)
        if interactor is not None:
            self._observers = [
                interactor.add_observer("InteractionEvent", lambda *_: self.update(**MOVING_QUALITY)),
                interactor.add_observer("EndInteractionEvent", lambda *_: self.update()),
            ]

    def update(self, **quality: Any) -> NDArray[np.uint8]:
        """Draws the picture anew, after a change of the plotter. Returns it: (height, width, 3), uint8, sRGB.

        ``quality``: as for ``File.render``; by default that of ``add_volume``.
        """
        self._is_drawing = True
        try:
            self._actor.VisibilityOff()
            self._plotter.render()
            picture = self._compositor.picture(self._plotter, **(quality or self._quality))
            height, width, _ = picture.shape
            image = pv.ImageData(dimensions=(width, height, 1))
            image.point_data["picture"] = picture[::-1].reshape(-1, 3)
            self._mapper.SetInputData(image)
            self._actor.VisibilityOn()
            self._plotter.render()
        finally:
            self._is_drawing = False
        self._drawn = self._view()
        return picture

    def _follow(self, plotter: pv.BasePlotter) -> None:
        """Draws the first picture when the plotter does; without a window also those of changes."""
        window = plotter.render_window
        if self._is_drawing or self._is_removed or window is None or window.GetNeverRendered():
            return
        if self._drawn is None or (window.GetOffScreenRendering() and self._drawn != self._view()):
            self.update()

    def _view(self) -> Tuple[Any, ...]:
        """Returns the camera, the size and the state of the surfaces."""
        surfaces = [prop for prop in self._plotter.renderer.GetViewProps() if prop is not self._actor]
        changed = max((prop.GetRedrawMTime() for prop in surfaces), default=0)
        return camera_of(self._plotter), tuple(self._plotter.window_size), len(surfaces), changed

    def remove(self) -> None:
        """Takes the volume out of the plotter."""
        self._is_removed = True
        for observer in self._observers:
            self._plotter.iren.remove_observer(observer)
        self._plotter.renderer.RemoveViewProp(self._actor)


def add_volume(
    plotter: pv.BasePlotter, file: File, scene: Optional[SceneLike] = None, **quality: Any
) -> VolumeOverlay:
    """Shows a volume among the surfaces of a plotter, from its first picture on. When the mouse has moved the camera,
    draws the picture anew, and coarser while it moves: with an error of about .002, in at most 100 ms. Off-screen, each
    ``render`` of the plotter draws it anew if the view or the surfaces have changed.

    Arguments as for ``composite``. Call ``update`` of the result after other changes of a plotter with a window. Bars
    and texts of the plotter lie below.
    """
    refuse_unknown("add_volume()", quality, Quality.__annotations__)
    return VolumeOverlay(plotter, file, scene, quality)
