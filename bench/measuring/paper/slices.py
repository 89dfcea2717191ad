"""Slices: a field, its gradient and the gradient's error, on a plane of constant z."""

from dataclasses import dataclass

import matplotlib

matplotlib.use("Agg")
import numpy  # noqa: E402
import vtk  # noqa: E402
from matplotlib import colors, pyplot  # noqa: E402
from vtk.util import numpy_support  # noqa: E402

from .fields import angles, weighted  # noqa: E402
from .sheets import save  # noqa: E402

SMALLEST = 100  # gradients shorter by this factor are not shown: their directions are rounding of the values
HALF_AXES = 0.95 * 12**0.5  # in deviations, as in the kernel `moments`


@dataclass
class Plane:
    z: float
    low: tuple  # x and y of the window
    high: tuple
    width: int = 240  # pixels

    def __post_init__(self):
        self.pixel = (self.high[0] - self.low[0]) / self.width
        self.height = round((self.high[1] - self.low[1]) / self.pixel)
        x = self.low[0] + self.pixel * (numpy.arange(self.width) + 0.5)
        y = self.low[1] + self.pixel * (numpy.arange(self.height) + 0.5)
        self.x, self.y = x, y
        self.places = numpy.stack([*numpy.meshgrid(x, y), numpy.full((self.height, self.width), self.z)], axis=-1)


@dataclass
class Slice:
    """[y, x]: `values`, NaN where there is none; `gradients` of three components."""

    values: numpy.ndarray
    gradients: numpy.ndarray


def exact_slices(mesh, at_points, plane):
    """Returns two slices. A pixel takes its value from the tetrahedron round its centre. The first slice has the
    tetrahedron's gradient, the second the vectors `at_points` [point], interpolated."""
    grid = vtk.vtkUnstructuredGrid()
    grid.CopyStructure(mesh.grid)
    of_points, of_cells = grid.GetPointData(), grid.GetCellData()
    arrays = ((of_points, "value", mesh.values), (of_points, "smooth", at_points), (of_cells, "flat", mesh.gradients))
    for data, name, array in arrays:
        numbers = numpy_support.numpy_to_vtk(array, deep=True)
        numbers.SetName(name)
        data.AddArray(numbers)
    points = vtk.vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(plane.places.reshape(-1, 3), deep=True))
    pixels = vtk.vtkPolyData()
    pixels.SetPoints(points)
    probe = vtk.vtkProbeFilter()
    probe.SetInputData(pixels)
    probe.SetSourceData(grid)
    probe.Update()
    data = probe.GetOutput().GetPointData()
    names = ("vtkValidPointMask", "value", "flat", "smooth")
    inside, values, flat, smooth = (numpy_support.vtk_to_numpy(data.GetArray(name)) for name in names)
    shape = plane.places.shape[:2]
    values = numpy.where(inside == 1, values, numpy.nan).reshape(shape)
    return Slice(values, flat.reshape(*shape, 3)), Slice(values, smooth.reshape(*shape, 3))


def splat_slice(splats, vectors, plane):
    """Returns the means over the splats at each pixel, by density, of their linear fields and of `vectors`. The
    ellipsoids are those of the kernel `moments`, but not cut at the mesh's boundary, and no thinner than a pixel."""
    weights = numpy.zeros(plane.places.shape[:2])
    sums, values = numpy.zeros((*weights.shape, 3)), numpy.zeros(weights.shape)
    shapes = splats.covariances + plane.pixel**2 / 12 * numpy.eye(3)
    inverses = numpy.linalg.inv(shapes) / HALF_AXES**2
    densities = splats.masses / numpy.sqrt(numpy.linalg.det(shapes))
    reach = HALF_AXES * numpy.sqrt(numpy.einsum("nii->ni", shapes))
    near = numpy.abs(splats.centroids[:, 2] - plane.z) < reach[:, 2]
    for i in numpy.flatnonzero(near & (splats.masses > 0) & ~numpy.isnan(splats.means)):
        at = splats.centroids[i]
        columns = slice(*numpy.searchsorted(plane.x, (at[0] - reach[i, 0], at[0] + reach[i, 0])))
        rows = slice(*numpy.searchsorted(plane.y, (at[1] - reach[i, 1], at[1] + reach[i, 1])))
        offsets = plane.places[rows, columns] - at
        distances = numpy.einsum("...i,ij,...j", offsets, inverses[i], offsets)
        weight = densities[i] * numpy.maximum(0, 1 - distances) ** 1.5
        weights[rows, columns] += weight
        values[rows, columns] += weight * (splats.means[i] + offsets @ splats.gradients[i])
        sums[rows, columns] += weight[..., None] * vectors[i]
    with numpy.errstate(invalid="ignore", divide="ignore"):
        return Slice(values / weights, sums / weights[..., None])


class Figure:
    """Two rows of three panels: gradients above, angles to the exact gradient below."""

    def __init__(self, plane, exact):
        self.plane, self.exact = plane, exact
        shape = plane.height / plane.width
        size = (10, 5.7 * shape + 0.9)
        self.figure, panels = pyplot.subplots(2, 3, figsize=size, layout="constrained", sharex=True, sharey=True)
        self.panels = list(panels.flat)
        self.inside = ~numpy.isnan(exact.values)
        self.lengths = numpy.linalg.norm(exact.gradients, axis=-1)
        largest = numpy.percentile(self.lengths[self.inside], 99.5)
        self.scale = colors.LogNorm(largest / SMALLEST, largest)
        self.levels = numpy.linspace(*numpy.nanpercentile(exact.values, (0.5, 99.5)), 14)
        self.images = {"gradient": [], "angle": []}

    def draw(self, part, title, key, colour, **style):
        panel = self.panels.pop(0)
        plane, box = self.plane, (self.plane.low[0], self.plane.high[0], self.plane.low[1], self.plane.high[1])
        image = panel.imshow(colour, origin="lower", extent=box, interpolation="nearest", **style)
        values = numpy.where(self.inside, part.values, numpy.nan)
        panel.contour(plane.x, plane.y, values, self.levels, colors="white", linewidths=0.5)
        self.add_arrows(panel, part)
        panel.set_title(title, fontsize=8)
        panel.tick_params(labelsize=6)
        self.images[key].append((panel, image))

    def add_arrows(self, panel, part, step=11):
        """Adds arrows. The share of the gradient in the plane sets their length."""
        some = (slice(step // 2, None, step), slice(step // 2, None, step))
        with numpy.errstate(invalid="ignore", divide="ignore"):
            arrows = part.gradients[some] / numpy.linalg.norm(part.gradients[some], axis=-1)[..., None]
        arrows[~self.inside[some]] = numpy.nan
        arrows *= 0.9 * step * self.plane.pixel
        x, y = self.plane.x[some[1]], self.plane.y[some[0]]
        style = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
        panel.quiver(x, y, arrows[..., 0], arrows[..., 1], **style)

    def add_gradient(self, part, title):
        length = numpy.linalg.norm(part.gradients, axis=-1)
        self.draw(part, title, "gradient", numpy.where(self.inside, length, numpy.nan), norm=self.scale, cmap="viridis")

    def add_angle(self, part, title):
        shown = self.inside & (self.lengths > self.scale.vmin)
        angle = numpy.where(shown, angles(self.exact.gradients, part.gradients), numpy.nan)
        self.draw(part, title, "angle", angle, vmin=0, vmax=45, cmap="magma")

    def angle(self, part):
        """Returns mean and median of the degrees to the exact gradient, weighted by its length."""
        both = self.inside & ~numpy.isnan(part.values)
        return weighted(angles(self.exact.gradients, part.gradients)[both], self.lengths[both])

    def write(self, path):
        for key, label in (("gradient", "length of the gradient"), ("angle", "degrees to the exact one")):
            bar = self.figure.colorbar(self.images[key][0][1], ax=[panel for panel, _ in self.images[key]], shrink=0.9)
            bar.set_label(label, fontsize=7)
            bar.ax.tick_params(labelsize=6)
        self.figure.canvas.draw()
        save(numpy.asarray(self.figure.canvas.buffer_rgba())[..., :3].copy(), path)
        pyplot.close(self.figure)
