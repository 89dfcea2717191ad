"""What draws a file, for the parts of this package."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import dataclass
from typing import Any, Dict, Iterator, Optional, Tuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._arguments import as_number, as_size, as_whole
from ._scenes import Scene
from .errors import InvalidArgumentError

DEFAULT_MEMORY = 512 << 20  # bytes

#: The quality of pictures while a mouse moves: that of svview.
MOVING_QUALITY: Quality = {"max_error": 0.002, "milliseconds": 100}


@dataclass(frozen=True)
class Statistics:
    """What a picture shows and cost."""

    splats: int
    error: float  #: estimated, against the exact picture: root mean square of linear RGB
    is_complete: bool  #: nothing is missing of what was asked for
    is_settled: bool  #: it will not change: what is missing cannot be read or held
    missing_bytes: int  #: of the file, still to be read for the picture
    bytes_read: int  #: of the file, since it was opened for drawing
    bytes_held: int  #: of ``memory``, the most at any time
    requests: int  #: reads of the file; from a server, requests
    seconds: float
    #: errors of parts that could not be read: their places are drawn coarser. Also of patches of the boundary that are
    #: left out: they need more than a quarter of the memory
    unreadable: Tuple[str, ...]


class Quality(TypedDict, total=False):
    """How fine a picture is to be: at most one of these, or ``max_error`` with ``milliseconds``, for what moves.
    Without one, it is exact if the file keeps cells and that is about a second's work. Else it has all points of a
    small file, or an error of .002."""

    max_error: Optional[float]  #: root mean square of linear RGB, against the exact picture
    splats: Optional[int]  #: their number
    tolerance: Optional[float]  #: the largest share of the shorter side for a splat, in per cent; 0: all points
    resolution: Optional[int]  #: that of all points; 0: the coarsest
    exact: Optional[bool]  #: the cells that the file keeps, exactly, and no splats
    milliseconds: Optional[float]  #: the best picture that can be there by then; the speed is learned from call to call


_AS = {"max_error": as_number, "splats": as_whole, "tolerance": as_number, "resolution": as_whole,
       "milliseconds": as_number}


def _core_quality(quality: Quality) -> Any:
    numbers: Dict[str, Any] = {name: value for name, value in quality.items() if value is not None}
    for name, value in numbers.items():
        numbers[name] = _AS[name](name, value) if name in _AS else bool(value)
    return _core.Quality(**numbers)


class Renderer:
    """An open file, its scene, and the processor that draws it. One call at a time."""

    def __init__(self, path: str, memory: int, step: int) -> None:
        memory = as_whole("memory", memory)
        if memory <= 0:
            raise InvalidArgumentError(f"a memory of {memory} bytes: take more")
        self.memory = memory
        self._renderer = _core.Renderer(os.fsencode(path), memory)
        self.show_step(step)

    def show_step(self, step: int) -> None:
        if self._renderer.step() != step:
            self._renderer.show_step(step)

    def scene(self) -> Scene:
        return json.loads(self._renderer.scene())

    def set_scene(self, scene: Scene) -> None:
        self._renderer.set_scene(json.dumps(scene))

    def fitting_scene(self, attribute: Optional[str], size: Tuple[int, int]) -> Scene:
        """``attribute``: None: the one with most to see."""
        return json.loads(self._renderer.fitting_scene(attribute or "", *as_size(size)))

    @contextlib.contextmanager
    def surfaces(self, depths: Optional[ArrayLike]) -> Iterator[None]:
        """Hides what lies behind surfaces, for the calls inside."""
        if depths is None:
            yield
            return
        array = np.ascontiguousarray(depths, np.float32)
        if array.ndim != 2:
            raise InvalidArgumentError(f"depths have the shape (height, width), not {array.shape}")
        self._renderer.set_surface_depths(array)
        try:
            yield
        finally:
            self._renderer.set_surface_depths(None)

    def render(self, quality: Quality = {}) -> NDArray[np.float32]:
        return self._renderer.render(_core_quality(quality))

    def render_now(self, wait_seconds: float, quality: Quality = {}) -> NDArray[np.float32]:
        return self._renderer.render_now(wait_seconds, _core_quality(quality))

    def statistics(self) -> Statistics:
        values = self._renderer.statistics()
        return Statistics(**{**values, "unreadable": tuple(values["unreadable"])})
