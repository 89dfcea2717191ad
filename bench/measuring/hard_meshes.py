"""The meshes of bench/svbench hard, written as .vtu files in double precision."""

import base64
import math
import struct
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

import numpy as np

TETRAHEDRON, HEXAHEDRON, WEDGE, POLYHEDRON, VERTEX = 10, 12, 13, 42, 1
TYPES = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}
# A hexahedron's tetrahedra round the diagonal from its first to its seventh corner: neighbours agree.
SPLIT = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]


@dataclass
class Mesh:
    points: np.ndarray  # [point, 3]
    cells: np.ndarray  # [cell, corner]; no rows: points only
    kind: int = TETRAHEDRON  # of the cells, as VTK numbers them
    values: dict = field(default_factory=dict)  # name: [point]
    names: tuple = ()  # instead of the keys of `values`: may repeat one
    faces: np.ndarray = None  # [cell, number]: of polyhedra, as VTK's stream of faces

    suffix = ".vtu"

    def scaled(self, factor, shift=0.0):
        return Mesh(self.points * factor + shift, self.cells, self.kind, dict(self.values))

    def with_values(self, values, name="f"):
        return Mesh(self.points, self.cells, self.kind, {name: np.asarray(values, float)})

    def write(self, path):
        cells, kind = self.cells, self.kind
        if len(cells) == 0:
            cells, kind = np.arange(len(self.points)).reshape(-1, 1), VERTEX
        offsets = np.arange(1, len(cells) + 1) * cells.shape[1]

        names = self.names or tuple(self.values)
        streams = []
        if self.faces is not None:
            ends = np.arange(1, len(cells) + 1) * self.faces.shape[1]
            streams = [data_array("faces", self.faces.astype("i8")), data_array("faceoffsets", ends.astype("i8"))]
        path.write_text(
            '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64"><UnstructuredGrid>\n'
            f'<Piece NumberOfPoints="{len(self.points)}" NumberOfCells="{len(cells)}"><PointData>\n'
            + "".join(data_array(name, values.astype("f8")) for name, values in zip(names, self.values.values()))
            + "</PointData><Points>\n"
            + data_array("Points", self.points.astype("f8"))
            + "</Points><Cells>\n"
            + data_array("connectivity", cells.astype("i8"))
            + data_array("offsets", offsets.astype("i8"))
            + data_array("types", np.full(len(cells), kind, "u1"))
            + "".join(streams)
            + "</Cells></Piece></UnstructuredGrid></VTKFile>\n"
        )


def data_array(name, content):
    """An array of VTK's XML. Binary: VTK reads no NaN in text."""
    components = 3 if name == "Points" else 1
    raw = struct.pack("<Q", content.nbytes) + content.astype(content.dtype.newbyteorder("<")).tobytes()
    return (
        f"<DataArray type={quoteattr(TYPES[content.dtype.str[1:]])} Name={quoteattr(name, {chr(10): '&#10;', chr(27): '?'})} "
        f'NumberOfComponents="{components}" format="binary">{base64.b64encode(raw).decode()}\n</DataArray>\n'
    )


@dataclass
class Points:
    """Scattered points of a mesh, as a file of this suffix: .npy, .csv or .vtp."""

    of: Mesh
    suffix: str

    def write(self, path):
        name, values = next(iter(self.of.values.items()))
        table = np.column_stack([self.of.points, values])
        if self.suffix == ".npy":
            np.save(path, table)
        elif self.suffix == ".csv":
            np.savetxt(path, table, delimiter=",", fmt="%.17g", header=f"x,y,z,{name}", comments="")
        else:
            count = len(table)
            path.write_text(
                '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>'
                f'<Piece NumberOfPoints="{count}" NumberOfVerts="0"><PointData>\n'
                + data_array(name, values.astype("f8"))
                + "</PointData><Points>\n"
                + data_array("Points", self.of.points.astype("f8"))
                + "</Points></Piece></PolyData></VTKFile>\n"
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


def in_prisms(mesh):
    halves = [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)]
    return Mesh(mesh.points, np.concatenate([mesh.cells[:, list(half)] for half in halves]), WEDGE, dict(mesh.values))


def in_polyhedra(mesh):
    """Hexahedra as polyhedra: each with the stream of its six faces."""
    sides = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    parts = [np.full((len(mesh.cells), 1), 6)]
    for side in sides:
        parts += [np.full((len(mesh.cells), 1), 4), mesh.cells[:, list(side)]]
    return Mesh(mesh.points, mesh.cells, POLYHEDRON, dict(mesh.values), faces=np.concatenate(parts, 1))


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


def body_in_another(cells=12):
    """A lattice whose middle is a body of its own, with value 1; the rest has value 0. No point is in both."""
    box = lattice(cells)
    inside = np.abs(box.points[box.cells].mean(1)).max(1) < 0.5
    points, cells, values = np.zeros((0, 3)), np.zeros((0, 8), int), np.zeros(0)
    for value, body in ((1.0, box.cells[inside]), (0.0, box.cells[~inside])):
        used, corners = np.unique(body, return_inverse=True)
        cells = np.concatenate([cells, corners.reshape(body.shape) + len(points)])
        points = np.concatenate([points, box.points[used]])
        values = np.append(values, np.full(len(used), value))
    return Mesh(points, cells, HEXAHEDRON).with_values(values)


def layers_round_a_sphere(layers=10, halvings=3):
    """Wedges round a sphere of radius 1, in layers as thin as those of an ocean: 1.6e-6 to 2.4e-4."""
    points, triangles = icosphere(halvings)
    depths = np.append(0, np.cumsum(np.geomspace(1.6e-6, 2.4e-4, layers)))
    upper = np.concatenate([triangles + len(points) * layer for layer in range(layers)])
    all_points = np.concatenate([points * (1 - depth) for depth in depths])
    return Mesh(all_points, np.hstack([upper + len(points), upper]), WEDGE).with_values(smooth(all_points))


def icosphere(halvings):
    """The points of a sphere of radius 1, and its triangles: an icosahedron's, each divided into four so many times."""
    g = (1 + math.sqrt(5)) / 2
    points = [np.roll([0.0, a, b], shift) for shift in range(3) for a in (-1, 1) for b in (-g, g)]
    points = [p / length(p) for p in points]
    nearest = 1.1 * min(length(points[0] - p) for p in points[1:])
    near = [[length(a - b) < nearest for b in points] for a in points]
    triangles = [(a, b, c) for c in range(12) for b in range(c) for a in range(b) if near[a][b] and near[b][c] and near[a][c]]
    triangles = [(a, b, c) if np.linalg.det([points[a], points[b], points[c]]) > 0 else (b, a, c) for a, b, c in triangles]
    for _ in range(halvings):
        middles, finer = {}, []

        def middle(a, b):
            if (key := (min(a, b), max(a, b))) not in middles:
                middles[key] = len(points)
                points.append((points[a] + points[b]) / length(points[a] + points[b]))
            return middles[key]

        for a, b, c in triangles:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = finer
    return np.array(points), np.array(triangles)


def points_only(count):
    return Mesh(np.random.default_rng(2).uniform(-1, 1, (count, 3)), np.zeros((0, 4), int))


def decades_of(mesh, decades):
    """Values that fall by so many powers of ten along x."""
    x = (mesh.points[:, 0] + 1) / 2
    return mesh.with_values(10.0 ** (-decades * (1 - x)))


def length(vector):
    return math.sqrt(float(np.dot(vector, vector)))
