"""Open .svol files."""

from __future__ import annotations

import math
import os
import threading
import warnings
from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
    Union,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._arguments import as_number, refuse_unknown
from ._build import Progress
from ._conversions import convert, is_mesh
from ._data_sets import cells_data_set, contour_data_set, import_pyvista, tell_left_out
from ._renderers import DEFAULT_MEMORY, Quality, Renderer, Statistics
from ._scenes import Scene, SceneLike, read_scene, refuse_both, with_size
from .errors import InvalidArgumentError

if TYPE_CHECKING:
    import pyvista as pv
    from typing_extensions import Unpack

Path = Union[str, "os.PathLike[str]"]
Vector = Tuple[float, float, float]
Floats = NDArray[np.float64]


class Attribute(NamedTuple):
    """A named number at each point."""

    name: str
    unit: str  #: such as "m/s"; empty: not known
    low: float  #: the least value; NaN if no point has one
    high: float
    missing: int  #: points without a value
    error: float  #: no stored value differs by more from that of the input


@dataclass(frozen=True)
class Points:
    """Points of one resolution. A point of a coarse resolution stands for those near it that the resolution lacks.

    Arrays are in the file's order of points. NaN: missing. The last five are empty unless ``material`` was asked for.
    """

    resolution: int
    positions: Floats  #: (n, 3), world units
    values: Dict[str, Floats]  #: attribute: (n,), at the positions
    volumes: Floats  #: (n,), of the material that each point stands for
    centroids: Floats  #: (n, 3), of the material
    covariances: Floats  #: (n, 6), of the material: xx, yy, zz, xy, yz, xz
    means: Dict[str, Floats]  #: attribute: (n,), of the values in the material
    deviations: Dict[str, Floats]  #: attribute: (n,), standard deviations of the values in the material


@dataclass(frozen=True)
class LineSamples:
    """Values along a line. NaN: no cell, or no value."""

    arc_lengths: Floats  #: (n,), from the start, world units; they do not fall
    positions: Floats  #: (n, 3), world units
    values: Dict[str, Floats]  #: attribute: (n,)


@dataclass(frozen=True)
class Streamline:
    """A line that is everywhere parallel to a vector. Rows follow each other with the vectors. Without rows, the seed is
    at an end."""

    seed: int  #: its number
    positions: Floats  #: (n, 3), world units
    times: Floats  #: (n,), from the seed, lengths over speeds; negative against the vectors
    values: Dict[str, Floats]  #: attribute: (n,)
    begin: str  #: why it ends at its first row: seed, mesh, missing, no_speed, length or steps
    end: str  #: and at its last


class Integral(NamedTuple):
    """The integral of an attribute over cells. Without volume, the mean and what stands after it are NaN."""

    volume: float  #: of the parts of cells with a value
    missing_volume: float  #: of those without
    integral: float  #: of the values over the volume
    mean: float
    low: float  #: the least value
    low_position: Vector  #: where it is; of several places, the first in the file
    high: float
    high_position: Vector
    unit: str  #: of the values, such as "m/s"; empty: not known


class SurfaceIntegral(NamedTuple):
    """The integral of an attribute over a surface. Without area, the mean and what stands after it are NaN."""

    area: float  #: of the parts with a value
    missing_area: float  #: of those without
    integral: float  #: of the values over the area
    mean: float
    low: float  #: the least value
    low_position: Vector  #: where it is; of several places, the first in the file
    high: float
    high_position: Vector
    unit: str  #: of the values, such as "m/s"; empty: not known


class SurfaceIntegrals(NamedTuple):
    """Integrals over a contour or a slice."""

    area: float
    flux: float  #: of the vector: along a slice's normal, through a contour to lower values; NaN without a vector
    enclosed_volume: float  #: inside a closed contour that nothing cuts, negative round a hole; else NaN
    attributes: Dict[str, SurfaceIntegral]


class Frame(NamedTuple):
    """A picture on the way to the complete one."""

    picture: NDArray[np.float32]  #: (height, width, 4)
    statistics: Statistics


#: Those of ``File.streamlines``, in the order of the library.
_DIRECTIONS = ("both", "forward", "backward")

#: Options of ``File.render`` and ``File.frames`` that are not of the quality.
_DRAWING = {"scene", "size", "attribute", "memory"}


def _paths(path: Union[Path, Sequence[Path]]) -> List[str]:
    if isinstance(path, (str, bytes, os.PathLike)):
        return [os.fsdecode(path)]
    return [os.fsdecode(one) for one in path]


def _corner(corner: Sequence[float]) -> Vector:
    x, y, z = corner
    return float(x), float(y), float(z)


def _corners(box: Optional[Tuple[Sequence[float], Sequence[float]]]) -> Optional[Tuple[Vector, Vector]]:
    return None if box is None else (_corner(box[0]), _corner(box[1]))


def _planes(planes: Sequence[Tuple[Sequence[float], Sequence[float]]]) -> List[Tuple[Vector, Vector]]:
    return [(_corner(point), _corner(normal)) for point, normal in planes]


def _limits(
    ranges: Optional[Mapping[str, Tuple[Optional[float], Optional[float]]]],
) -> List[Tuple[str, float, float]]:
    return [
        (name, -math.inf if low is None else float(low), math.inf if high is None else float(high))
        for name, (low, high) in (ranges or {}).items()
    ]


def _tell_unknown(what: str, size: float, name: str) -> None:
    if size > 0:
        warnings.warn(
            f"{name}: {'an' if what[0] in 'aeiou' else 'a'} {what} of {size:.6g} is left out: an attribute of ranges has "
            "no value there",
            stacklevel=3,
        )


def _names(attributes: Optional[Sequence[str]]) -> List[str]:
    return [attributes] if isinstance(attributes, str) else list(attributes or [])


class File:
    """An open .svol file, or an index of files (.svols); of a time series, at one of its steps. Of a mesh, the file
    that it was converted to.

    Each byte is checked before it is used. All calls may come from any thread: others go on while one reads or draws.
    Pictures are drawn one after another. Ctrl-C ends a call.
    """

    def __init__(
        self,
        path: Union[Path, Sequence[Path]],
        *,
        step: Optional[int] = None,
        time: Optional[float] = None,
        progress: Optional[Progress] = None,
    ) -> None:
        """As ``open``."""
        if step is not None and time is not None:
            raise InvalidArgumentError("a step is chosen by its number or by its time, not by both")
        paths = _paths(path)
        if not paths:
            raise InvalidArgumentError("no path: give that of a file")
        self._path, self._keeper = paths[0], None
        if is_mesh(paths):
            self._path, self._keeper = convert(paths, step is not None or time is not None, progress)
        self._opened: Optional[_core.File] = _core.File(os.fsencode(self._path))
        self._name = self._opened.name() if self._keeper is None else paths[0]
        self._lock = threading.Lock()
        self._renderer: Optional[Renderer] = None
        if step is not None:
            self.show_step(step)
        if time is not None:
            self.show_time(time)

    @property
    def _file(self) -> _core.File:
        if self._opened is None:
            raise InvalidArgumentError(f"{self.name}: the file is closed: open it again")
        return self._opened

    def close(self) -> None:
        """Gives back what the file holds: memory, and what was made to open it. Later calls raise
        ``InvalidArgumentError``. Arrays and pictures stay, and so do iterators of ``frames``."""
        with self._lock:
            self._renderer = None
            self._opened = None
            if self._keeper is not None:
                self._keeper.release()

    def __enter__(self) -> File:
        """Returns the file, which the end of a ``with`` block closes."""
        self._file  # raises if it is closed
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        if self._opened is None:
            return f"splatvol.open({self.name!r}): closed"
        return f"splatvol.open({self.name!r}): {self.point_count} points, {', '.join(a.name for a in self.attributes)}"

    @property
    def name(self) -> str:
        """The name for messages: the path, or the address without user, password and query; of a mesh, its own path."""
        return self._name

    @property
    def path(self) -> str:
        """The path or address that was opened; of a mesh, the path of the .svol file that it was converted to."""
        return self._path

    @property
    def attributes(self) -> List[Attribute]:
        """What the file holds at each point."""
        return [Attribute(*row) for row in self._file.attributes()]

    @property
    def resolution_counts(self) -> List[int]:
        """The number of points of each resolution, which rises."""
        return self._file.resolution_counts()

    @property
    def point_count(self) -> int:
        """The number of points of the finest resolution."""
        return self.resolution_counts[-1]

    @property
    def bounds(self) -> Tuple[Vector, Vector]:
        """The low and the high corner of the box round the mesh, in world units: round its cells, else its points."""
        return self._file.bounds()

    @property
    def times(self) -> List[float]:
        """The times of the steps, which rise; empty if the file is no time series."""
        return self._file.times()

    @property
    def step(self) -> int:
        """The number of the step that is shown, from 0."""
        return self._file.step()

    def show_step(self, step: int) -> None:
        """Changes to another step, by its number from 0. If it fails, all stays as it was.

        Raises ``InvalidArgumentError`` if there is no such step.
        """
        self._file.show_step(step)

    @property
    def time(self) -> Optional[float]:
        """The time of the step that is shown; None if the file is no time series."""
        times = self.times
        return times[self.step] if times else None

    def show_time(self, time: float) -> None:
        """Changes to the step nearest to a time; of two, the earlier. If it fails, all stays as it was.

        Raises ``InvalidArgumentError`` if the file is no time series, or if the time is not finite.
        """
        if not self.times:
            raise InvalidArgumentError(f"{self.name}: no time series, so it has no steps")
        if not np.isfinite(time):
            raise InvalidArgumentError(f"{self.name}: {time} is no time")
        self.show_step(self._file.nearest_step(time))

    def range_of(self, attribute: str) -> Tuple[float, float]:
        """Returns the least and the largest value of an attribute over all steps; NaN if no point has one.

        Raises ``InvalidArgumentError`` if the file lacks the attribute.
        """
        if all(attribute != one.name for one in self.attributes):
            raise InvalidArgumentError(f"{self.name}: no attribute {attribute!r}")
        return self._file.range_of(attribute)

    @property
    def file_bytes(self) -> int:
        """The size of the file."""
        return self._file.file_bytes()

    @property
    def bytes_read(self) -> int:
        """The bytes that this object has read of the file; pictures read beside it."""
        return self._file.bytes_read()

    def points(
        self,
        resolution: Optional[int] = None,
        max_points: Optional[int] = None,
        box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
        attributes: Optional[Sequence[str]] = None,
        material: bool = False,
    ) -> Points:
        """Reads points. The arrays are those that were read, not copies.

        ``resolution``: 0 is the coarsest. None: the finest with at most ``max_points`` points; if there is none, the
        coarsest. ``box``: its low and its high corner, in world units; points outside are left out, and chunks that lie
        outside are not read. ``attributes``: names; None: all. ``material``: also what each point stands for.

        Raises ``InvalidArgumentError`` if the file lacks the resolution or an attribute, ``FileError`` or
        ``InvalidDataError`` if it cannot be read.
        """
        read = self._file.points(resolution, max_points, _names(attributes), _corners(box), material)
        names = read["names"]
        return Points(
            resolution=read["resolution"],
            positions=read["positions"],
            values=dict(zip(names, read["values"])),
            volumes=read.get("volumes", np.empty(0)),
            centroids=read.get("centroids", np.empty((0, 3))),
            covariances=read.get("covariances", np.empty((0, 6))),
            means=dict(zip(names, read.get("means", []))),
            deviations=dict(zip(names, read.get("deviations", []))),
        )

    def sample(
        self, points: ArrayLike, attribute: Optional[str] = None, resolution: Optional[int] = None
    ) -> Floats:
        """Returns the values of an attribute at positions: (n,), NaN where no material is, or no value.

        ``points``: (n, 3), world units; copied unless float64 and contiguous. ``attribute``: None: the first. Takes
        about 64 bytes for each position.

        Of a file that keeps cells, values are the mesh's own: linear in each tetrahedron of a cell, or the value of the
        cell where cells have values of their own. At a point of the mesh, it is the point's value up to the file's
        rounding. Where cells overlap, the first of the file counts.

        Of other files, or with a ``resolution``, they are the means of the splats' linear fields, weighted by their
        densities. All of the resolution (None: the finest) is read, chunk by chunk.

        Raises ``InvalidArgumentError`` if the file lacks the attribute or the resolution.
        """
        positions = np.ascontiguousarray(points, np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise InvalidArgumentError(f"{self.name}: positions have the shape (n, 3), not {positions.shape}")
        name = self.attributes[0].name if attribute is None else attribute
        return self._file.sample(positions, name, resolution)

    def sample_line(
        self,
        start: Sequence[float],
        end: Sequence[float],
        attributes: Optional[Sequence[str]] = None,
        samples: Optional[int] = None,
    ) -> LineSamples:
        """Returns the values of attributes (None: all) along the line between two positions, of a file that keeps cells.

        A row stands at each crossing from a tetrahedron of the cells to another, and at both ends. Between two rows, all
        values are linear. Where values jump, two rows have one position: at borders of blocks and of cells that have
        values of their own, and where the line enters or leaves the mesh. Outside, values are NaN, so that a plot of
        them has gaps. ``samples``: so many rows in equal steps instead, both ends included.

        Raises ``InvalidArgumentError`` if the file keeps no cells or lacks an attribute, or if the line has no length.
        """
        read = self._file.sample_line(_corner(start), _corner(end), _names(attributes), samples)
        return LineSamples(read["arc_lengths"], read["positions"], dict(zip(read["names"], read["values"])))

    def cells(
        self,
        attributes: Optional[Sequence[str]] = None,
        box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
    ) -> pv.UnstructuredGrid:
        """Returns the cells that the file keeps, as a data set of PyVista with the values of attributes (None: all).
        Its arrays are those that were read, not copies.

        Hexahedra, pyramids, wedges and tetrahedra are what they were; polyhedra are split into their tetrahedra. A
        vector is an array (n, 3), without its magnitude. Values are at the points, or in the cells where they have
        values of their own. ``box``: its low and its high corner: cells whose own boxes meet it, and no others.

        Raises ``InvalidArgumentError`` if the file keeps no cells, lacks an attribute or has nothing in the box;
        ``UnsupportedError`` without PyVista.
        """
        pyvista = import_pyvista("cells()")
        return cells_data_set(pyvista, self._file.cells(_names(attributes), _corners(box)), self.name)

    def contour(
        self,
        value: float,
        attribute: Optional[str] = None,
        attributes: Optional[Sequence[str]] = None,
        box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
    ) -> pv.PolyData:
        """Returns the surface on which an attribute (None: the first) has a value, in the cells that the file keeps: a
        data set of PyVista with the values of ``attributes`` (None: all). Its arrays are those that were read.

        The surface is that of the linear interpolation in each tetrahedron of the cells, exact up to rounding: closed,
        but at the border of the mesh, of the ``box``, and of cells with a missing value. Vectors and ``box`` as for
        ``cells``.

        Raises ``InvalidArgumentError`` if the file keeps no cells, lacks an attribute, or has the value nowhere;
        ``UnsupportedError`` if cells have values of their own, or without PyVista.
        """
        pyvista = import_pyvista("contour()")
        name = self.attributes[0].name if attribute is None else attribute
        read = self._file.contour(as_number("value", value), name, _names(attributes), _corners(box))
        return contour_data_set(pyvista, read, self.name)

    def integrate(
        self,
        attributes: Optional[Sequence[str]] = None,
        box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
        clip_planes: Sequence[Tuple[Sequence[float], Sequence[float]]] = (),
        ranges: Optional[Mapping[str, Tuple[Optional[float], Optional[float]]]] = None,
    ) -> Dict[str, Integral]:
        """Returns volume, integral, mean, and the least and the greatest value of attributes (None: all), over the cells
        that the file keeps. Values are linear in each tetrahedron of a cell, or those of the cell.

        Cells are cut exactly: by ``box``, its low and its high corner; by ``clip_planes``, each a point and a normal,
        which points to the side that stays; and by ``ranges``, {attribute: (low, high)}, with None for no limit. Memory
        does not grow with the file.

        Cells with a missing value are left out: of the attribute in ``missing_volume``, of ``ranges`` with a warning.

        Raises ``InvalidArgumentError`` if the file keeps no cells or lacks an attribute, or if the box, a plane or a
        range is none.
        """
        read = self._file.integrate(
            _names(attributes), _corners(box), _planes(clip_planes), _limits(ranges)
        )
        tell_left_out(read["left_out"], self.name, stacklevel=3)
        _tell_unknown("volume", read["unknown_volume"], self.name)
        return {row.pop("name"): Integral(**row) for row in read["attributes"]}

    def integrate_surface(
        self,
        contour: Optional[Tuple[str, float]] = None,
        slice: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
        attributes: Optional[Sequence[str]] = None,
        box: Optional[Tuple[Sequence[float], Sequence[float]]] = None,
        clip_planes: Sequence[Tuple[Sequence[float], Sequence[float]]] = (),
        ranges: Optional[Mapping[str, Tuple[Optional[float], Optional[float]]]] = None,
        vector: Optional[str] = None,
    ) -> SurfaceIntegrals:
        """Returns area, mean and extremes as ``integrate`` does, over a surface in the cells: the ``contour`` of an
        attribute at a value, or the ``slice`` by a plane, given as a point and a normal. With ``vector``, an attribute
        of three components, also its flux.

        The surface is that of ``contour``, and of the distance from the plane. It is cut exactly, as cells are. A face
        of cells in the plane counts once.

        Raises ``InvalidArgumentError`` as ``integrate`` does, and if ``vector`` has no three components;
        ``UnsupportedError`` for the contour of cells that have values of their own.
        """
        if (contour is None) == (slice is None):
            raise InvalidArgumentError("integrate_surface(): give either contour or slice")
        place = None if contour is None else (str(contour[0]), as_number("contour", contour[1]))
        plane = None if slice is None else _planes([slice])[0]
        components = [f"{vector}[{i}]" if vector else "" for i in range(3)]
        read = self._file.integrate_surface(
            place, plane, _names(attributes), _corners(box), _planes(clip_planes), _limits(ranges), components
        )
        tell_left_out(read["left_out"], self.name, stacklevel=3)
        _tell_unknown("area", read["unknown_area"], self.name)
        rows = {row.pop("name"): SurfaceIntegral(**row) for row in read["attributes"]}
        return SurfaceIntegrals(read["area"], read["flux"], read["enclosed_volume"], rows)

    def streamlines(
        self,
        vector: str,
        seeds: Optional[ArrayLike] = None,
        *,
        patch: Optional[str] = None,
        count: int = 100,
        attributes: Optional[Sequence[str]] = None,
        direction: str = "both",
        max_length: Optional[float] = None,
        max_steps: int = 10_000,
    ) -> List[Streamline]:
        """Returns the streamlines of a vector in the cells that the file keeps: one for each seed, with the values of
        attributes (None: all). The vector ``U`` has the attributes ``U[0]``, ``U[1]`` and ``U[2]``.

        ``seeds``: (n, 3), world units; or ``count`` of them on a ``patch`` of the boundary. ``direction``: "forward" with
        the vectors, "backward" or "both". ``max_length`` (None: five diagonals of the mesh's box) and ``max_steps``: from
        the seed, each way.

        The vector is linear in each tetrahedron of the cells. Steps are those of Dormand and Prince, no longer than a
        tetrahedron, and off by 1e-5 of it, as estimated. Lines end at the mesh's end, at a missing value, where nothing
        moves, and at the limits. Ctrl-C ends the call.

        Raises ``InvalidArgumentError`` if the file keeps no cells, lacks the vector or the patch, or if no seed has a
        line; ``UnsupportedError`` if cells have values of their own.
        """
        if (seeds is None) == (patch is None):
            raise InvalidArgumentError("streamlines begin at seeds or on a patch: give one of both")
        if direction not in _DIRECTIONS:
            raise InvalidArgumentError(f"direction {direction!r} is none of {', '.join(_DIRECTIONS)}")
        positions = np.ascontiguousarray(np.empty((0, 3)) if seeds is None else seeds, np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise InvalidArgumentError(f"{self.name}: seeds have the shape (n, 3), not {positions.shape}")
        names, lines = self._file.streamlines(
            vector, positions, patch, count, _names(attributes), _DIRECTIONS.index(direction), max_length, max_steps
        )
        return [
            Streamline(seed, at, times, dict(zip(names, values)), begin, end)
            for seed, at, times, values, begin, end in lines
        ]

    def verify(self, progress: Optional[Callable[[float], Any]] = None) -> None:
        """Checks every byte of the file; of an index, of the files of all steps, and its units and ranges.

        Calls ``progress`` with the share that is done, in [0, 1].

        Raises ``InvalidDataError``, which names the first rule that is broken.
        """
        self._file.verify(progress)

    def scene(
        self,
        attribute: Optional[str] = None,
        size: Tuple[int, int] = (512, 512),
        *,
        memory: int = DEFAULT_MEMORY,
    ) -> Scene:
        """Returns a scene that fits the data, in the layout of docs/scene.md: a start for one of your own.

        ``attribute``: None: the one with most to see. ``size``: width and height of the picture, in pixels.
        """
        with self._lock:
            return self._get_renderer(memory).fitting_scene(attribute, size)

    def render(
        self,
        scene: Optional[SceneLike] = None,
        size: Optional[Tuple[int, int]] = None,
        *,
        attribute: Optional[str] = None,
        seconds: Optional[float] = None,
        depths: Optional[ArrayLike] = None,
        memory: int = DEFAULT_MEMORY,
        **quality: Unpack[Quality],
    ) -> NDArray[np.float32]:
        """Draws the complete picture: (height, width, 4), linear premultiplied RGBA, row 0 at the top.

        ``scene``: a dictionary or the path of a scene file (docs/scene.md); None: one that fits the data.
        ``attribute``: without a scene, what to show; None: the one with most to see. ``size``: width and height,
        instead of the scene's. The background is not applied: ``to_srgb8`` and ``save`` do that.

        ``quality``: at most one of these says how fine the picture is to be. Without one, it is exact if the file keeps
        cells and that is about a second's work. Else it has all points of a small file, or an error of .002.

        - ``max_error``: root mean square of linear RGB, against the exact picture
        - ``splats``: their number
        - ``tolerance``: the largest share of the shorter side that a splat may cover, in per cent; 0: all points
        - ``resolution``: that of all points; 0: the coarsest
        - ``milliseconds``: the best picture that can be there by then; the speed is learned from call to call
        - ``exact=True``: the cells of a file that keeps them, exactly, and no splats

        ``seconds`` is deprecated: give ``milliseconds``.

        ``depths``: (height, width), opaque surfaces that hide what lies behind them: at each pixel's centre, the
        distance from the eye's plane along the view's axis, in world units; infinity or NaN: none. ``memory``: bytes to
        hold of the file; a view that needs more is drawn coarser. They are held for the next call.

        Raises ``InvalidArgumentError`` or ``InvalidDataError`` for a scene with an error, ``FileError`` if a part of
        the file cannot be read.
        """
        refuse_unknown("render()", quality, _DRAWING | {"depths"} | Quality.__annotations__.keys())
        if seconds is not None:
            warnings.warn("render(seconds=T) is render(milliseconds=1000 * T)", DeprecationWarning, stacklevel=2)
            if any(number is not None for number in quality.values()):
                raise InvalidArgumentError("give one of seconds and the other numbers that say how fine, not two")
            quality = {"milliseconds": 1000 * seconds}
        with self._lock:
            renderer = self._get_renderer(memory)
            renderer.set_scene(self._scene_for(renderer, scene, attribute, size))
            with renderer.surfaces(depths):
                return renderer.render(quality)

    def frames(
        self,
        scene: Optional[SceneLike] = None,
        size: Optional[Tuple[int, int]] = None,
        *,
        attribute: Optional[str] = None,
        interval: float = 0.1,
        memory: int = DEFAULT_MEMORY,
        **quality: Unpack[Quality],
    ) -> Iterator[Frame]:
        """Draws picture after picture while the file loads; the last one is complete. The first comes at once.

        Arguments as for ``render``, besides ``exact`` and ``milliseconds``. ``interval``: seconds to wait for more of
        the file before the next picture. Each picture is an array of its own. A part that cannot be read is in
        ``statistics.unreadable``, and its place drawn coarser.
        """
        refuse_unknown("frames()", quality, _DRAWING | {"interval"} | Quality.__annotations__.keys())
        renderer = Renderer(self._path, memory, self.step)
        renderer.set_scene(self._scene_for(renderer, scene, attribute, size))
        wait = 0.0
        while True:
            picture = renderer.render_now(wait, quality)
            statistics = renderer.statistics()
            yield Frame(picture, statistics)
            if statistics.is_settled:
                return
            wait = interval

    @property
    def statistics(self) -> Optional[Statistics]:
        """What the last picture of ``render`` shows and cost; None before the first."""
        with self._lock:
            return None if self._renderer is None else self._renderer.statistics()

    def _get_renderer(self, memory: int) -> Renderer:
        if self._renderer is None or self._renderer.memory != memory:
            self._renderer = None  # gives its memory back first
            self._renderer = Renderer(self._path, memory, self.step)
        self._renderer.show_step(self.step)
        return self._renderer

    @staticmethod
    def _scene_for(
        renderer: Renderer, scene: Optional[SceneLike], attribute: Optional[str], size: Optional[Tuple[int, int]]
    ) -> Scene:
        if scene is None:
            return renderer.fitting_scene(attribute, (512, 512) if size is None else size)
        refuse_both(scene, attribute)
        return with_size(read_scene(scene), size)


def open(
    path: Union[Path, Sequence[Path]],
    *,
    step: Optional[int] = None,
    time: Optional[float] = None,
    progress: Optional[Progress] = None,
) -> File:
    """Opens a .svol file, or an index of files (.svols), by its path or address (http://, https:// or ssh://); or a
    mesh, by the path of its file or folder, or by a list of paths: pieces, or a grid of PLOT3D and its solution.

    Of a time series, shows the step of a number from 0, the step nearest to a time, or the last one. Of a .svol file,
    reads the preamble only.

    A mesh is converted first, by the program ``svbuild`` if it is on PATH: it reads all formats of docs/formats.md, and
    keeps the result in its cache for the next call. Of a mesh with time steps, the last one is converted; with ``step``
    or ``time``, all are. Without svbuild, PyVista reads the mesh, and a file is built that goes with the ``File``.
    ``progress(stage, share)``: called now and then. What svbuild notes is a warning of Python.

    Raises ``MissingFileError``, ``FileError`` or ``InvalidDataError``; ``InvalidArgumentError`` if there is no such
    step; ``UnsupportedError`` for a mesh if there is neither svbuild nor PyVista.
    """
    return File(path, step=step, time=time, progress=progress)
