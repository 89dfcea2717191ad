"""Meshes of a file as data sets of PyVista, which is imported here only."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Dict, Iterable, Tuple

from numpy.typing import NDArray

from .errors import UnsupportedError

if TYPE_CHECKING:
    import pyvista as pv


def import_pyvista(call: str) -> Any:
    try:
        import pyvista
    except ImportError:
        raise UnsupportedError(
            f"{call} returns a data set of PyVista, which is not installed: pip install pyvista"
        ) from None
    return pyvista


def cells_data_set(pv: Any, mesh: Dict[str, Any], name: str) -> pv.UnstructuredGrid:
    """Makes a grid of the arrays that were read, without copies."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    tell_left_out(mesh["left_out"], name)
    if mesh["split"]:
        warnings.warn(
            f"{name}: {mesh['split']} cells are split into tetrahedra: a reader of rounded corners would choose others",
            stacklevel=3,
        )
    cells = vtkCellArray()
    cells.SetData(numpy_to_vtkIdTypeArray(mesh["offsets"]), numpy_to_vtkIdTypeArray(mesh["connectivity"]))
    grid = pv.UnstructuredGrid()
    grid.SetPoints(pv.vtk_points(mesh["points"], deep=False))
    grid.SetCells(numpy_to_vtk(mesh["types"]), cells)
    _add(grid.point_data, mesh["point_values"])
    _add(grid.cell_data, mesh["cell_values"])
    return grid


def contour_data_set(pv: Any, mesh: Dict[str, Any], name: str) -> pv.PolyData:
    """Makes a surface of the arrays that were read, without copies."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    tell_left_out(mesh["left_out"], name)
    triangles = vtkCellArray()
    triangles.SetData(3, numpy_to_vtkIdTypeArray(mesh["triangles"].reshape(-1)))
    surface = pv.PolyData()
    surface.SetPoints(pv.vtk_points(mesh["points"], deep=False))
    surface.SetPolys(triangles)
    _add(surface.point_data, mesh["point_values"])
    return surface


def _add(data: Any, arrays: Iterable[Tuple[str, NDArray[Any]]]) -> None:
    for name, values in arrays:
        data.set_array(values, name)


def tell_left_out(cells: int, name: str, stacklevel: int = 4) -> None:
    if cells:
        warnings.warn(
            f"{name}: {cells} cells are left out: this version does not know their shape", stacklevel=stacklevel
        )
