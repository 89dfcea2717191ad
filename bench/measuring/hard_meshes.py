"""The meshes of bench/svhard, written as .vtu files in double precision."""

import math
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

import numpy as np

TETRAHEDRON, HEXAHEDRON, VERTEX = 10, 12, 1
# A hexahedron's tetrahedra round the diagonal from its first to its seventh corner: neighbours agree.
SPLIT = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]


@dataclass
class Mesh:
    points: np.ndarray  # [point, 3]
    cells: np.ndarray  # [cell, corner]; no rows: points only
    kind: int = TETRAHEDRON  # of the cells, as VTK numbers them
    values: dict = field(default_factory=dict)  # name: [point]

    def scaled(self, factor, shift=0.0):
        return Mesh(self.points * factor + shift, self.cells, self.kind, dict(self.values))

    def with_values(self, values, name="f"):
        return Mesh(self.points, self.cells, self.kind, {name: np.asarray(values, float)})

    def write(self, path):
        cells, kind = self.cells, self.kind
        if len(cells) == 0:
            cells, kind = np.arange(len(self.points)).reshape(-1, 1), VERTEX
        offsets = np.arange(1, len(cells) + 1) * cells.shape[1]

        def numbers(array):
            return " ".join(repr(float(x)) if array.dtype.kind == "f" else str(x) for x in array.ravel())

        def array(name, kind_name, content, components=1):
            return (
                f"<DataArray type={quoteattr(kind_name)} Name={quoteattr(name, {chr(10): '&#10;', chr(27): '?'})} "
                f'NumberOfComponents="{components}" format="ascii">{numbers(content)}\n</DataArray>\n'
            )

        path.write_text(
            '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"><UnstructuredGrid>\n'
            f'<Piece NumberOfPoints="{len(self.points)}" NumberOfCells="{len(cells)}"><PointData>\n'
            + "".join(array(name, "Float64", values) for name, values in self.values.items())
            + "</PointData><Points>\n"
            + array("Points", "Float64", self.points.astype(float), 3)
            + "</Points><Cells>\n"
            + array("connectivity", "Int64", cells)
            + array("offsets", "Int64", offsets)
            + array("types", "UInt8", np.full(len(cells), kind))
            + "</Cells></Piece></UnstructuredGrid></VTKFile>\n"
        )


def smooth(points):
    """A field without symmetry, from about -1 to 1 on a body of size 2 round the origin."""
    x, y, z = points.T
    return 0.6 * x + 0.3 * np.sin(3 * y) + 0.2 * np.cos(4 * z) * x


def lattice(cells=10, sides=(1.0, 1.0, 1.0), low=(-1.0, -1.0, -1.0)):
    """Hexahedra that fill a box from `low` with sides of twice `sides`."""
    counts = [cells] * 3 if np.isscalar(cells) else list(cells)
    axes = [np.linspace(l, l + 2 * s, n + 1) for l, s, n in zip(low, sides, counts)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape([n + 1 for n in counts])
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    ends = [number[tuple(slice(c, c + n) for c, n in zip(at, counts))].ravel() for at in corner]
    mesh = Mesh(grid, np.stack(ends, 1), HEXAHEDRON)
    return mesh.with_values(smooth(grid))


def in_tetrahedra(mesh):
    cells = np.concatenate([mesh.cells[:, list(split)] for split in SPLIT])
    return Mesh(mesh.points, cells, TETRAHEDRON, dict(mesh.values))


def ball(cells=12):
    """A ball of radius 1: a lattice of tetrahedra, pulled onto it and jittered."""
    mesh = in_tetrahedra(lattice(cells))
    p = mesh.points
    largest, length = np.abs(p).max(1), np.linalg.norm(p, axis=1)
    p = p * (largest / np.maximum(length, 1e-300))[:, None]
    inner = largest < 0.999
    p[inner] += np.random.default_rng(1).uniform(-0.15, 0.15, (inner.sum(), 3)) / cells
    return Mesh(p, mesh.cells, TETRAHEDRON).with_values(smooth(p))


def graded(decades=9, layers=60):
    """Tetrahedra whose sizes fall towards a corner by so many powers of ten."""
    edges = np.concatenate([[0.0], np.logspace(-decades, 0, layers)]) * 2 - 1
    mesh = lattice((layers, 4, 4))
    p = mesh.points.copy()
    p[:, 0] = np.repeat(edges, 25)
    return in_tetrahedra(Mesh(p, mesh.cells, HEXAHEDRON).with_values(smooth(p)))


def hanging(cells=6):
    """Two lattices, one twice as fine, whose points on the common face do not match."""
    coarse = lattice(cells, (0.5, 1, 1))
    fine = lattice(2 * cells, (0.5, 1, 1), (0, -1, -1))
    points = np.concatenate([coarse.points, fine.points])
    joined = Mesh(points, np.concatenate([coarse.cells, fine.cells + len(coarse.points)]), HEXAHEDRON)
    return joined.with_values(smooth(points))


def flat(ratio):
    """A lattice that is `ratio` times wider than high."""
    return in_tetrahedra(lattice(10, (1, 1, 1 / ratio), (-1, -1, -1 / ratio)))


def one_tetrahedron():
    p = np.array([[-1, -1, -1], [1, -1, -0.5], [0, 1, -1], [0, 0, 1.0]])
    return Mesh(p, np.array([[0, 1, 2, 3]])).with_values(smooth(p))


def two_bodies():
    """A ball, and a thousand times smaller one in front of it."""
    large, small = ball(10), ball(10).scaled(1e-3, np.array([0, 0, 1.5]))
    points = np.concatenate([large.points, small.points])
    mesh = Mesh(points, np.concatenate([large.cells, small.cells + len(large.points)]))
    return mesh.with_values(np.concatenate([large.values["f"], ball(10).values["f"]]))


def points_only(count):
    return Mesh(np.random.default_rng(2).uniform(-1, 1, (count, 3)), np.zeros((0, 4), int))


def decades_of(mesh, decades):
    """Values that fall by so many powers of ten along x."""
    x = (mesh.points[:, 0] + 1) / 2
    return mesh.with_values(10.0 ** (-decades * (1 - x)))


def length(vector):
    return math.sqrt(float(np.dot(vector, vector)))
