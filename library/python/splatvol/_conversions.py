"""Meshes that become .svol files when they are opened."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import warnings
import weakref
from typing import Any, List, Optional, Sequence, Tuple

from . import _core
from ._build import Progress, Step, build_arrays, build_steps
from ._vtk_arrays import MeshArrays, arrays_of_mesh
from .errors import Error, InvalidArgumentError, InvalidDataError, MissingFileError, UnsupportedError

_OPTIONS = {"boundary_triangles": 200_000}  # as svbuild keeps them, if nothing else is said


def is_mesh(paths: Sequence[str]) -> bool:
    """Whether files are a mesh or points that have to be converted first, by their names."""
    if len(paths) == 1 and paths[0].startswith(("http://", "https://", "ssh://")):
        return False
    return _core.needs_conversion([os.fsencode(path) for path in paths])


def convert(paths: List[str], all_steps: bool, progress: Optional[Progress]) -> Tuple[str, Any]:
    """Converts a mesh by svbuild, which keeps the file in its cache. Without it, PyVista reads the mesh, and a
    temporary file is built. Returns the path of the .svol file, and what keeps the file until it is released.

    ``all_steps``: of a mesh with time steps; else the last one.
    """
    for path in paths:
        if not os.path.exists(path):
            raise MissingFileError(f"{path}: {os.strerror(errno.ENOENT)}")
    svbuild = _find_svbuild()
    if svbuild is None:
        output, keeper, notes = _convert_by_pyvista(paths, all_steps, progress)
    else:
        keeper = _core.convert([os.fsencode(path) for path in paths], all_steps, os.fsencode(svbuild), progress)
        output, notes = os.fsdecode(keeper.path()), keeper.notes()
    for note in notes:
        warnings.warn(note, stacklevel=4)  # the caller of open()
    return output, keeper


def _find_svbuild() -> Optional[str]:
    beside = os.fsdecode(_core.usual_svbuild())
    return shutil.which("svbuild") or (beside if os.path.isabs(beside) else None)


class _TemporaryFolder:
    """A folder that goes when it is released, or with this object."""

    def __init__(self) -> None:
        self.path = tempfile.mkdtemp(prefix="splatvol-")
        self.release = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


def _convert_by_pyvista(
    paths: List[str], all_steps: bool, progress: Optional[Progress]
) -> Tuple[str, Any, List[str]]:
    """Returns what ``convert`` does, and notes for the user."""
    try:
        import pyvista
    except ImportError:
        raise UnsupportedError(
            f"{paths[0]}: a mesh: name the folder of svbuild in PATH, which converts it; or pip install pyvista"
        ) from None
    folder = _TemporaryFolder()
    try:
        output = os.path.join(folder.path, "mesh.svol")
        name = os.fsencode(paths[0]).decode("utf-8", "backslashreplace")
        steps = _read_steps(pyvista, paths, all_steps)
        if len(steps) == 1:
            report = build_arrays(steps[0][1], output, dict(_OPTIONS), progress, name)
        else:
            _check_same_mesh(paths[0], [mesh for _, mesh in steps])
            values = [Step(time, mesh.point_values, mesh.cell_values) for time, mesh in steps]
            report = build_steps(steps[0][1], values, output, dict(_OPTIONS), False, progress, name)
    except BaseException:
        folder.release()
        raise
    return output, folder, report.warnings + report.conversions


def _read_steps(pv: Any, paths: List[str], all_steps: bool) -> List[Tuple[float, MeshArrays]]:
    """Reads the steps of a file, or pieces of a mesh, with their times."""
    try:
        if len(paths) > 1:
            return [(0.0, _arrays(pv, paths[0], pv.MultiBlock([pv.read(path) for path in paths])))]
        reader = pv.get_reader(paths[0])
        times = list(getattr(reader, "time_values", None) or [])
        if not times:
            return [(0.0, _arrays(pv, paths[0], pv.read(paths[0])))]
        steps = []
        for time in times if all_steps else times[-1:]:
            reader.set_active_time_value(time)
            steps.append((time, _arrays(pv, paths[0], reader.read())))
        return steps
    except Error:
        raise
    except Exception as error:  # of any kind: PyVista's, VTK's, or those of other packages that PyVista calls
        words = " ".join(str(error).split()) or type(error).__name__
        raise InvalidDataError(
            f"{paths[0]}: PyVista does not read it ({words}): svbuild may: name its folder in PATH"
        ) from error


def _arrays(pv: Any, path: str, data: Any) -> MeshArrays:
    try:
        return arrays_of_mesh(data.combine() if isinstance(data, pv.MultiBlock) else data)
    except InvalidArgumentError as error:
        raise InvalidDataError(f"{path}: as PyVista reads it, {error}: svbuild may: name its folder in PATH") from error


def _check_same_mesh(path: str, meshes: List[MeshArrays]) -> None:
    first = meshes[0]
    for mesh in meshes[1:]:
        for name in ("points", "connectivity", "offsets", "types", "faces"):
            one, other = getattr(first, name), getattr(mesh, name)
            if one.shape != other.shape or (one != other).any():
                raise UnsupportedError(
                    f"{path}: its mesh changes from step to step: svbuild converts it: name its folder in PATH"
                )
