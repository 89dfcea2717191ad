"""A picture in a notebook that the mouse turns, moves and zooms. Needs anywidget, and uses Pillow if it is there."""

from __future__ import annotations

import io
import pathlib
from typing import Any, Dict, List, Optional, Tuple

import anywidget
import numpy as np
import traitlets
from numpy.typing import NDArray

from . import _camera
from ._arguments import as_size
from ._files import File
from ._pictures import encode_png, to_srgb8
from ._renderers import DEFAULT_MEMORY, MOVING_QUALITY, Renderer
from ._scenes import Scene, SceneLike, read_scene, refuse_both, with_size
from .errors import Error

# Between pictures while the file loads.
_LOADING_SECONDS = 0.2


def _encode_jpeg(pixels: NDArray[np.uint8]) -> Optional[bytes]:
    """Returns the bytes of a JPEG file; None without Pillow."""
    try:
        from PIL import Image
    except ImportError:
        return None
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=85)
    return file.getvalue()


class Viewer(anywidget.AnyWidget):
    """A file's picture in a notebook.

    The left button turns, the right one (or Shift) moves, the wheel zooms, and a double click goes back to the first
    view. While the mouse moves, pictures have an error of about .002, and take at most 100 ms for it; at rest the picture
    becomes complete. ``scene`` is what is shown.
    """

    _esm = pathlib.Path(__file__).with_name("widget.js")
    size = traitlets.List(traitlets.Int(), [640, 480]).tag(sync=True)

    def __init__(
        self,
        file: File,
        scene: Optional[SceneLike] = None,
        size: Tuple[int, int] = (640, 480),
        *,
        attribute: Optional[str] = None,
    ) -> None:
        """``scene``: the first view; None: one that fits the data. ``attribute``: without a scene, what to show.
        ``size``: width and height, in pixels."""
        refuse_both(scene, attribute)
        self._file = file  # of a mesh, the converted file goes with it
        width, height = as_size(size)
        self._renderer = Renderer(file.path, DEFAULT_MEMORY, file.step)
        self._first = (
            self._renderer.fitting_scene(attribute, size) if scene is None else with_size(read_scene(scene), size)
        )
        self._scene = self._first
        super().__init__(size=[width, height])
        self.on_msg(self._on_message)

    @property
    def scene(self) -> Scene:
        """The scene that is shown, for ``File.render`` or a scene file."""
        return read_scene(self._scene)

    @scene.setter
    def scene(self, scene: SceneLike) -> None:
        self._scene = with_size(read_scene(scene), (self.size[0], self.size[1]))
        self._send_moving()

    def _on_message(self, _: Any, message: Dict[str, Any], __: List[bytes]) -> None:
        """Answers each message of the page with one picture, so that pictures never queue up."""
        try:
            if message["kind"] == "move":
                self._move(message)
                self._send_moving()
            else:
                self._send_resting()
        except Error as error:
            self.send({"kind": "error", "text": str(error)})

    def _move(self, message: Dict[str, Any]) -> None:
        if message.get("reset"):
            self._scene = self._first
            return
        camera = _camera.turn(self._scene["camera"], *message["turn"])
        camera = _camera.drag(camera, *message["drag"])
        self._scene = {**self._scene, "camera": _camera.zoom(camera, message["zoom"])}

    def _send_moving(self) -> None:
        self._renderer.set_scene(self._scene)
        self._send_picture(self._renderer.render(MOVING_QUALITY), is_moving=True, is_settled=False)

    def _send_resting(self) -> None:
        self._renderer.set_scene(self._scene)
        picture = self._renderer.render_now(_LOADING_SECONDS)
        is_settled = self._renderer.statistics().is_settled
        if is_settled:
            picture = self._renderer.render()
        self._send_picture(picture, is_moving=False, is_settled=is_settled)

    def _send_picture(self, picture: NDArray[np.float32], is_moving: bool, is_settled: bool) -> None:
        pixels = to_srgb8(picture, self._scene.get("background", (0, 0, 0)))
        jpeg = _encode_jpeg(pixels) if is_moving or not is_settled else None
        type_, data = ("image/jpeg", jpeg) if jpeg is not None else ("image/png", encode_png(pixels))
        self.send({"kind": "picture", "type": type_, "moving": is_moving, "settled": is_settled}, buffers=[data])
