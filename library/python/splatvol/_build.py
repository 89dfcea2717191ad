"""Arrays to .svol files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._arguments import as_number, refuse_unknown
from ._vtk_arrays import MeshArrays, arrays_of_mesh
from .errors import InvalidArgumentError

Cells = Union[None, ArrayLike, Tuple[ArrayLike, ArrayLike, ArrayLike]]
Progress = Callable[[str, float], Any]

# VTK's number of the cell type with so many points.
_TYPES_BY_POINTS = {4: 10, 5: 14, 6: 13, 8: 12}


@dataclass(frozen=True)
class BuildReport:
    """What was built."""

    path: str
    resolution_counts: List[int]  #: points of each resolution; the last one has all
    file_bytes: int
    connectivity: str  #: that was used
    census: Dict[str, int]  #: what was counted or left out, in words
    warnings: List[str]
    conversions: List[str]  #: attributes that are not as in the input
    kept_cells: int  #: in the file; of an append 0


class Step(NamedTuple):
    """The values of a time series at a time."""

    time: float
    values: Mapping[str, ArrayLike]  #: at the points: (n,) or (n, k)
    cell_values: Mapping[str, ArrayLike] = {}  #: in the cells: (m,) or (m, k)


def _array(array: ArrayLike) -> NDArray[Any]:
    """Returns an array, with its mask if it has one. NumPy drops the masks of arrays in a list."""
    parts = array if isinstance(array, (list, tuple)) else [array]
    has_mask = any(isinstance(part, np.ma.MaskedArray) for part in parts)
    return np.ma.asarray(array) if has_mask else np.asarray(array)


def _floats(array: ArrayLike) -> NDArray[Any]:
    """Returns numbers in single or double precision, row by row; the caller's own array if it is like that. Masked
    ones are NaN."""
    numbers = _array(array)
    if numbers.dtype not in (np.float32, np.float64):
        if numbers.dtype.kind not in "fiub":
            raise InvalidArgumentError(f"numbers are needed, not {numbers.dtype}")
        numbers = numbers.astype(np.float64)
    if np.ma.is_masked(numbers):
        numbers = np.ma.filled(numbers, np.nan)
    return np.ascontiguousarray(np.ma.getdata(numbers))


def _refuse_masked(array: NDArray[Any], what: str) -> None:
    if np.ma.is_masked(array):
        raise InvalidArgumentError(f"{what}: masked numbers ({np.ma.count_masked(array)}): leave them out")


def _indices(array: ArrayLike, what: str) -> NDArray[np.int64]:
    """Returns integers of 64 bits; the caller's own array if it is like that."""
    numbers = _array(array)
    _refuse_masked(numbers, what)
    if numbers.dtype.kind not in "iu" and numbers.size > 0:
        raise InvalidArgumentError(f"{what}: whole numbers are needed, not {numbers.dtype}")
    return np.ascontiguousarray(np.ma.getdata(numbers), np.int64)


def _cells(cells: Cells) -> Tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Returns connectivity, offsets and types, as in VTK."""
    if cells is None:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint8)
    if isinstance(cells, tuple):
        connectivity, offsets, types = cells
        kinds = _indices(types, "types")
        if kinds.size > 0 and (kinds.min() < 0 or kinds.max() > 255):
            raise InvalidArgumentError("types of cells are VTK's numbers, from 0 to 255")
        return (
            _indices(connectivity, "connectivity").reshape(-1),
            _indices(offsets, "offsets").reshape(-1),
            np.ascontiguousarray(kinds, np.uint8).reshape(-1),
        )
    corners = _indices(cells, "cells")
    if corners.ndim != 2 or corners.shape[1] not in _TYPES_BY_POINTS:
        raise InvalidArgumentError(
            f"cells of the shape {corners.shape}: take (m, 4) tetrahedra, (m, 5) pyramids, (m, 6) wedges, "
            "(m, 8) hexahedra, or (connectivity, offsets, types)"
        )
    count, points = corners.shape
    offsets = np.arange(0, points * (count + 1), points, dtype=np.int64)
    return corners.reshape(-1), offsets, np.full(count, _TYPES_BY_POINTS[points], np.uint8)


def _named(values: Mapping[str, ArrayLike], units: Mapping[str, str], rows: int, what: str) -> List[Any]:
    named = []
    for name, array in values.items():
        unit = units.get(name, "")
        if not isinstance(name, str) or not isinstance(unit, str):
            raise TypeError(f"{name!r} with the unit {unit!r}: names and units are texts")
        numbers = _floats(array)
        if numbers.ndim not in (1, 2) or numbers.shape[0] != rows:
            shapes = f"({rows},) or ({rows}, k)"
            raise InvalidArgumentError(f"{name}: {rows} {what} need the shape {shapes}, not {numbers.shape}")
        named.append(_core.NamedValues(name, numbers, unit))
    return named


def build(
    points: ArrayLike,
    cells: Cells,
    values: Optional[Mapping[str, ArrayLike]],
    path: Union[str, "os.PathLike[str]"],
    *,
    cell_values: Optional[Mapping[str, ArrayLike]] = None,
    units: Mapping[str, str] = {},
    own_cells: bool = False,
    connectivity: str = "auto",
    reduction: str = "octree",
    missing: Sequence[float] = (),
    exact: bool = False,
    strict: bool = False,
    memory: int = 0,
    temp_folder: Union[None, str, "os.PathLike[str]"] = None,
    up: str = "",
    boundary_triangles: int = 0,
    keep_cells: bool = True,
    progress: Optional[Progress] = None,
) -> BuildReport:
    """Builds a .svol file from a mesh or from scattered points. It appears whole or not at all.

    ``points``: (n, 3), world units. ``cells``: None (scattered points), an array of point numbers of one cell type:
    (m, 4) tetrahedra, (m, 5) pyramids, (m, 6) wedges, (m, 8) hexahedra; or the tuple (connectivity, offsets, types) of
    VTK, with m + 1 offsets. Points of cells are in VTK's order. ``values``: arrays at the points by name: (n,), or
    (n, k) vectors, which give an attribute for the magnitude and one for each component. NaN, or masked: missing.

    Arrays of float32 or float64 (values, points) and int64 (cells) that are contiguous are read where they lie; others
    are copied. They must not change meanwhile.

    ``cell_values``: arrays in the cells, (m,) or (m, k); averaged to points, unless ``own_cells``: then each cell
    becomes a point with one value. ``units``: name: unit. ``connectivity``: how points are joined: "auto", "mesh",
    "delaunay", "none" (Voronoi cells) or "boxes". ``reduction``: "octree", "mis" or "kdtree". ``missing``: numbers that
    stand for missing values. ``exact``: rounds nothing, but values to single precision unless they have it. ``strict``:
    fails if the file would not be the input as it is. ``memory``: bytes to hold besides the arrays; 0: a quarter of the
    machine's. ``temp_folder``: None: the output's folder. ``up``: "x", "y" or "z", upwards in pictures.
    ``boundary_triangles``: most triangles of the mesh's boundary, kept for scenes that draw it, 0: none. Faces on a side
    of the mesh's box are the patches "side x-" to "side z+", and connected parts of the others "outer 1", "outer 2", ...,
    the largest first; "outer" is all of them. ``keep_cells``: the file keeps the cells, or the Delaunay tetrahedra that join the points: by them pictures are exact. ``progress(stage,
    share)``: called now and then, with the share of the stage that is done.

    Raises ``InvalidArgumentError`` or ``InvalidDataError`` if arrays do not fit each other, or if a coordinate or a
    point number is masked, ``UnsupportedError`` for cells of other types, ``FileError`` if the disk refuses. Then, and after Ctrl-C, a file that was there stays.
    """
    mesh = _mesh(points, cells)._replace(point_values=dict(values or {}), cell_values=dict(cell_values or {}))
    options = dict(
        units=units, own_cells=own_cells, connectivity=connectivity, reduction=reduction, missing=missing, exact=exact,
        strict=strict, memory=memory, temp_folder=temp_folder, up=up,
        boundary_triangles=boundary_triangles, keep_cells=keep_cells,
    )
    return build_arrays(mesh, path, options, progress)


def build_mesh(
    mesh: Any,
    path: Union[str, "os.PathLike[str]"],
    *,
    arrays: Optional[Sequence[str]] = None,
    progress: Optional[Progress] = None,
    **options: Any,
) -> BuildReport:
    """Builds a .svol file from a data set of PyVista or VTK with volume cells. It appears whole or not at all.

    ``mesh``: an unstructured grid, or another data set that can be cast to one; its polyhedra too. ``arrays``: names of
    its arrays of points and cells; None: all that are numbers. ``options``: those of ``build`` from ``units`` on.
    Copies what ``build`` copies, and the offsets and faces of cells where VTK holds them in another layout.

    Raises ``InvalidArgumentError`` if it is no data set, lacks an array or has ghost cells; else as ``build``.
    """
    return build_arrays(arrays_of_mesh(mesh, arrays), path, options, progress)


def build_series(
    points: ArrayLike,
    cells: Cells,
    steps: Iterable[Union[Step, Tuple[Any, ...]]],
    path: Union[str, "os.PathLike[str]"],
    *,
    append: bool = False,
    progress: Optional[Progress] = None,
    **options: Any,
) -> BuildReport:
    """Builds a time series: one .svol file with one mesh, and the values of all steps.

    ``points``, ``cells``: as for ``build``. ``steps``: tuples (time, values) or (time, values, cell_values), as
    ``Step`` has them. Times rise; all steps have arrays of the same names and shapes. The arrays of all steps are held
    at once: where memory ends, build from the first ones, and append the others. ``options``: those of ``build`` from
    ``units`` on.

    ``append=True`` adds steps to a series that is there, behind its last time. Points, cells, and the options that
    choose how they are joined, must be as they were; ``keep_cells`` is that of the file. If this fails, or by Ctrl-C, the file stays as it was, unless
    the message says that the steps are in the file.

    The report is that of the first steps that are built together; warnings are of all. Raises as ``build``, and
    ``InvalidArgumentError`` or ``InvalidDataError`` if times do not rise, steps differ in their names, or the file has
    another mesh.
    """
    return build_steps(_mesh(points, cells), [Step(*step) for step in steps], path, options, append, progress)


def _mesh(points: ArrayLike, cells: Cells) -> MeshArrays:
    given = _array(points)
    _refuse_masked(given, "points")
    positions = _floats(given)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise InvalidArgumentError(f"points have the shape (n, 3), not {positions.shape}")
    none = np.empty(0, np.int64)
    return MeshArrays(positions, *_cells(cells), none, none, {}, {})


def _check_units(units: Mapping[str, str], *values: Mapping[str, ArrayLike]) -> None:
    for name in units:
        if not any(name in arrays for arrays in values):
            raise InvalidArgumentError(f"unit of {name}: there is no such array")


def _both_named(
    values: Mapping[str, ArrayLike], cell_values: Mapping[str, ArrayLike], units: Mapping[str, str], mesh: MeshArrays
) -> Tuple[List[Any], List[Any]]:
    return _named(values, units, len(mesh.points), "points"), _named(cell_values, units, len(mesh.types), "cells")


def _core_mesh(mesh: MeshArrays, units: Mapping[str, str]) -> Any:
    return _core.Mesh(
        _floats(mesh.points), mesh.connectivity, mesh.offsets, mesh.types, mesh.faces, mesh.face_locations,
        *_both_named(mesh.point_values, mesh.cell_values, units, mesh),
    )


_OPTIONS = {
    "own_cells", "connectivity", "reduction", "missing", "exact", "strict", "memory", "temp_folder", "up",
    "boundary_triangles", "keep_cells",
}


def _core_options(options: Mapping[str, Any], name: str) -> Any:
    if len(options.get("up") or "") > 1:
        raise InvalidArgumentError(f"up {options['up']!r}: take x, y or z")
    refuse_unknown("the build", options, _OPTIONS | {"units", "progress"})
    core_options = _core.BuildOptions()
    core_options.name = name
    for name, value in options.items():
        if value is None:
            continue
        as_core = {"missing": list, "temp_folder": os.fspath}.get(name)
        setattr(core_options, name, as_core(value) if as_core else value)
    return core_options


def _report(report: Dict[str, Any], path: Union[str, "os.PathLike[str]"]) -> BuildReport:
    return BuildReport(**{**report, "path": os.fsdecode(path), "census": dict(report["census"])})


def build_steps(
    mesh: MeshArrays,
    steps: List[Step],
    path: Union[str, "os.PathLike[str]"],
    options: Dict[str, Any],
    append: bool,
    progress: Optional[Progress],
    name: str = "arrays",
) -> BuildReport:
    """As ``build_series``. ``name``: of the mesh, for messages. The mesh's own values do not count."""
    units = options.pop("units", {})
    for step in steps:
        _check_units(units, step.values, step.cell_values)
    named = [
        _core.Step(as_number("time", step.time), *_both_named(step.values, step.cell_values, units, mesh))
        for step in steps
    ]
    shared = _core_mesh(mesh._replace(point_values={}, cell_values={}), units)
    report = _core.build_series(shared, named, os.fsencode(path), _core_options(options, name), append, progress)
    return _report(report, path)


def build_arrays(
    mesh: MeshArrays,
    path: Union[str, "os.PathLike[str]"],
    options: Dict[str, Any],
    progress: Optional[Progress],
    name: str = "arrays",
) -> BuildReport:
    """As ``build`` and ``build_mesh``. ``name``: of the mesh, for messages."""
    units = options.pop("units", {})
    _check_units(units, mesh.point_values, mesh.cell_values)
    report = _core.build(_core_mesh(mesh, units), os.fsencode(path), _core_options(options, name), progress)
    return _report(report, path)
