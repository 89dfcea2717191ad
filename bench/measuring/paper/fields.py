"""Meshes of tetrahedra and exported splats as arrays, and the exact gradients of the meshes."""

import numpy
import vtk
from vtk.util import numpy_support


def read_grid(path):
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def write_grid(mesh, arrays, path):
    """Writes the mesh's cells, with arrays of its points by name."""
    grid = vtk.vtkUnstructuredGrid()
    grid.CopyStructure(mesh.grid)
    for name, values in arrays.items():
        numbers = numpy_support.numpy_to_vtk(values, deep=True)
        numbers.SetName(name)
        grid.GetPointData().AddArray(numbers)
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    if writer.Write() != 1:
        raise OSError(f"{path}: not written")


def points_of(grid):
    return numpy_support.vtk_to_numpy(grid.GetPoints().GetData()).astype(float)


def array_of(grid, name):
    return numpy_support.vtk_to_numpy(grid.GetPointData().GetArray(name)).astype(float)


class Tetrahedra:
    """A mesh of tetrahedra with one value for each point, linear in each tetrahedron.

    `volumes`, `gradients`: [tetrahedron]."""

    def __init__(self, path, attribute):
        self.grid = read_grid(path)
        kinds = vtk.vtkCellTypes()
        self.grid.GetCellTypes(kinds)
        if kinds.GetNumberOfTypes() != 1 or kinds.GetCellType(0) != vtk.VTK_TETRA:
            raise ValueError(f"{path}: cells that are no tetrahedra")
        self.points, self.values = points_of(self.grid), array_of(self.grid, attribute)
        cells = self.grid.GetCells().GetConnectivityArray()
        self.corners = numpy_support.vtk_to_numpy(cells).reshape(-1, 4)
        self.set_values(self.values)

    def set_values(self, values):
        """Replaces the field. A flat tetrahedron has the gradient 0."""
        self.values = values
        places, rises = self.points[self.corners], values[self.corners]
        edges, rises = places[:, 1:] - places[:, :1], rises[:, 1:] - rises[:, :1]
        a, b, c = edges[:, 0], edges[:, 1], edges[:, 2]
        determinant = numpy.einsum("ij,ij->i", a, numpy.cross(b, c))
        sums = (
            rises[:, :1] * numpy.cross(b, c) + rises[:, 1:2] * numpy.cross(c, a) + rises[:, 2:] * numpy.cross(a, b)
        )
        self.volumes = numpy.abs(determinant) / 6
        self.gradients = numpy.divide(
            sums, determinant[:, None], out=numpy.zeros_like(sums), where=determinant[:, None] != 0
        )


class Vertices:
    """The mesh's distinct positions. `masses`: a quarter of each tetrahedron at the position. `gradients`: their mean,
    by mass."""

    def __init__(self, mesh):
        self.mesh = mesh
        self.places, first, self.number = numpy.unique(mesh.points, axis=0, return_index=True, return_inverse=True)
        self.number = self.number.reshape(-1)
        self.values = mesh.values[first]
        self.corners = self.number[mesh.corners]
        self.masses = self.sum_up(mesh.volumes / 4)
        self.gradients = self.mean_gradients()
        locator = vtk.vtkStaticPointLocator()
        places = vtk.vtkPoints()
        places.SetData(numpy_support.numpy_to_vtk(self.places, deep=True))
        data = vtk.vtkPolyData()
        data.SetPoints(places)
        locator.SetDataSet(data)
        locator.BuildLocator()
        self.locator, self.data = locator, data

    def sum_up(self, of_tetrahedra):
        return sum(numpy.bincount(self.corners[:, k], of_tetrahedra, len(self.places)) for k in range(4))

    def mean_gradients(self):
        sums = [self.sum_up(self.mesh.volumes / 4 * self.mesh.gradients[:, k]) for k in range(3)]
        return numpy.stack(sums, axis=1) / numpy.maximum(self.masses, numpy.finfo(float).tiny)[:, None]

    def nearest(self, points):
        """Returns the index of the vertex nearest to each point."""
        return numpy.array([self.locator.FindClosestPoint(point) for point in points])


class Splats:
    """The splats of one resolution, as svexport writes them. `directions`: gradients by the paper's formula."""

    def __init__(self, path, attribute):
        grid = read_grid(path)
        self.points, self.masses = points_of(grid), array_of(grid, "mass")
        self.centroids = array_of(grid, "centroid")
        xx, yy, zz, xy, yz, xz = array_of(grid, "covariance").T
        self.covariances = numpy.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
        self.means = array_of(grid, f"{attribute} mean")
        self.gradients = array_of(grid, f"{attribute} gradient")
        self.directions = array_of(grid, f"{attribute} gradient direction")


def angles(a, b):
    """Returns the degrees between vectors: NaN where a is 0, and 90 where only b is 0."""
    lengths = numpy.linalg.norm(a, axis=-1), numpy.linalg.norm(b, axis=-1)
    with numpy.errstate(invalid="ignore", divide="ignore"):
        cosines = numpy.einsum("...i,...i", a, b) / lengths[0] / lengths[1]
    result = numpy.degrees(numpy.arccos(numpy.clip(cosines, -1, 1)))
    return numpy.where(lengths[0] == 0, numpy.nan, numpy.where(lengths[1] == 0, 90, result))


def weighted(values, weights):
    """Returns the weighted mean and median. Leaves out NaN."""
    known = ~numpy.isnan(values) & (weights > 0)
    values, weights = values[known], weights[known]
    order = numpy.argsort(values)
    sums = numpy.cumsum(weights[order])
    return numpy.average(values, weights=weights), values[order][numpy.searchsorted(sums, sums[-1] / 2)]
