"""The arrays of VTK's data sets. VTK is the caller's: nothing of it is imported before a data set is given."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidArgumentError

Indices = NDArray[np.int64]

POLYHEDRON = 42


class MeshArrays(NamedTuple):
    """A mesh as in VTK's vtkUnstructuredGrid, with the faces of polyhedra in its layout before 9.4."""

    points: NDArray[Any]  # (n, 3)
    connectivity: Indices
    offsets: Indices  # (cells + 1,)
    types: NDArray[np.uint8]
    faces: Indices  # for each polyhedron: faces, then for each of them: points, and these
    face_locations: Indices  # (cells,): where each polyhedron begins in `faces`; -1: another cell. Empty: no polyhedra
    point_values: Dict[str, Any]  # arrays
    cell_values: Dict[str, Any]


def arrays_of_mesh(mesh: Any, names: Optional[Sequence[str]] = None) -> MeshArrays:
    """Returns the arrays of a data set, of which they are views where possible."""
    grid = _as_grid(mesh)
    points = grid.GetPoints()
    if points is None or points.GetNumberOfPoints() == 0:
        raise InvalidArgumentError("the mesh has no points")
    cells = grid.GetCells()
    faces, face_locations = _faces(grid)
    point_values, cell_values = _values(grid.GetPointData()), _values(grid.GetCellData())
    if names is not None:
        _check_names(names, [*point_values, *cell_values])
        point_values = {name: array for name, array in point_values.items() if name in names}
        cell_values = {name: array for name, array in cell_values.items() if name in names}
    return MeshArrays(
        points=_numbers(points.GetData()),
        connectivity=_indices(cells.GetConnectivityArray()),
        offsets=_indices(cells.GetOffsetsArray()),
        types=_types(grid),
        faces=faces,
        face_locations=face_locations,
        point_values=point_values,
        cell_values=cell_values,
    )


def _check_names(names: Sequence[str], present: Sequence[str]) -> None:
    for name in names:
        if name not in present:
            raise InvalidArgumentError(f"the mesh has no array {name!r}; it has {', '.join(present)}")


def _as_grid(mesh: Any) -> Any:
    """Returns the data set as an unstructured grid."""
    is_a = getattr(mesh, "IsA", None)
    if is_a is None or not is_a("vtkDataSet"):
        raise InvalidArgumentError(f"a data set of PyVista or VTK is needed, not {type(mesh).__name__}")
    if is_a("vtkUnstructuredGrid"):
        return mesh
    if hasattr(mesh, "cast_to_unstructured_grid"):
        return mesh.cast_to_unstructured_grid()
    from vtkmodules.vtkFiltersCore import vtkAppendFilter

    append = vtkAppendFilter()
    append.AddInputData(mesh)
    append.Update()
    return append.GetOutput()


def _numbers(array: Any) -> NDArray[Any]:
    """Returns an array of VTK as NumPy's: a view, or a copy of an array that VTK computes when it is read."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if not array.HasStandardMemoryLayout():
        from vtkmodules.vtkCommonCore import vtkDataArray

        plain = vtkDataArray.CreateDataArray(array.GetDataType())
        plain.DeepCopy(array)
        array = plain
    return vtk_to_numpy(array)


def _indices(array: Any) -> Indices:
    return np.ascontiguousarray(_numbers(array), np.int64)


def _types(grid: Any) -> NDArray[np.uint8]:
    from vtkmodules.vtkCommonCore import vtkVersion

    since_9_6 = (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 6)
    array = grid.GetCellTypes() if since_9_6 else grid.GetCellTypesArray()
    return np.ascontiguousarray(_numbers(array), np.uint8) if array is not None else np.empty(0, np.uint8)


def _values(data: Any) -> Dict[str, NDArray[Any]]:
    """Returns the arrays of numbers. Names of ghosts are no values."""
    values = {}
    for index in range(data.GetNumberOfArrays()):
        array = data.GetArray(index)  # none if it is one of texts
        if array is None or not array.GetName():
            continue
        if array.GetName() not in ("vtkGhostType", "vtkGhostLevels"):
            values[array.GetName()] = _numbers(array)
        elif _numbers(array).any():
            raise InvalidArgumentError("the mesh has ghost points or cells: remove them first")
    return values


def _faces(grid: Any) -> Tuple[Indices, Indices]:
    """Returns the faces of polyhedra, and where each cell begins in them."""
    none = np.empty(0, np.int64)
    if not (_types(grid) == POLYHEDRON).any():
        return none, none
    if not hasattr(grid, "GetPolyhedronFaces"):  # VTK before 9.4
        return _indices(grid.GetFaces()), _indices(grid.GetFaceLocations())
    faces, cells = grid.GetPolyhedronFaces(), grid.GetPolyhedronFaceLocations()
    return face_stream(
        _indices(faces.GetConnectivityArray()), _indices(faces.GetOffsetsArray()),
        _indices(cells.GetConnectivityArray()), _indices(cells.GetOffsetsArray()),
    )


def face_stream(
    face_points: Indices, face_offsets: Indices, cell_faces: Indices, cell_offsets: Indices
) -> Tuple[Indices, Indices]:
    """Returns faces in VTK's layout before 9.4 from those in its layout since: lists of points of faces, and of faces
    of cells, which are empty for cells that are no polyhedra."""
    counts = np.diff(cell_offsets)  # [cell]: faces
    sizes = np.diff(face_offsets)[cell_faces]  # [face of a cell]: points
    is_polyhedron = counts > 0

    # A cell takes a number for its faces; a face takes one for its points, and these.
    ends = np.concatenate([[0], np.cumsum(1 + sizes)])
    begins = ends[cell_offsets[:-1]] + np.cumsum(is_polyhedron) - is_polyhedron
    locations = np.where(is_polyhedron, begins, -1)
    before = np.repeat(np.cumsum(is_polyhedron), counts)  # [face of a cell]: numbers of faces that come before it
    heads = ends[:-1] + before

    stream = np.empty(ends[-1] + is_polyhedron.sum(), np.int64)
    stream[begins[is_polyhedron]] = counts[is_polyhedron]
    stream[heads] = sizes
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    stream[np.repeat(heads + 1, sizes) + within] = face_points[np.repeat(face_offsets[cell_faces], sizes) + within]
    return stream, locations
