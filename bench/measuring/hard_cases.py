"""The cases of bench/svbench hard: meshes, scenes, and how far a picture may be from the exact one."""

import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Callable

import numpy as np

from . import hard_meshes as meshes

REFUSED = "refused"  # instead of a bound: one clear line, and no picture but an empty one
WITHOUT_OCTANT = ("splats", "OpenGL")
ROUNDED = 0.01  # where a rounded position or value moves what is seen
BALL = 0.01  # for the ball of 12 cells across, whatever its units are: ellipsoids make its surface


@dataclass
class Case:
    group: str
    name: str
    mesh: Callable  # makes it
    scene: dict  # None: the one that svrender makes
    bound: object  # of the root mean square error of linear RGB, or REFUSED; less than half of the signal
    quick: bool = False  # CI draws a sample of these
    projections: tuple = ("perspective", "orthographic")
    build: tuple = ()  # further options of svbuild
    exact: bool = True  # False: no exact picture; only that there is light in it
    vtk: bool = False  # compared with VTK
    baseline: bool = False  # compared with the exact picture of the base case, which units do not change
    truth: Callable = None  # makes the mesh of the exact picture, if it is another one
    ways: tuple = ()  # the only ways to draw it besides "exact"; none: all
    large: bool = False  # drawn as PNG: its numbers take gigabytes
    says: str = ""  # a part of the line, if REFUSED
    exact_bound: float = 0.002  # of the way "exact"

    def has_way(self, way):
        if way == "exact":
            return not self.large
        return not self.ways or way in self.ways


def scene(size=1.0, shift=(0.0, 0.0, 0.0), eye=(2.2, 1.6, 4.0), target=(0, 0, 0), fov=30.0, height=2.6, pixels=(256, 256),
          domain=(-1.0, 1.0), colors=None, density=None, attribute="f"):
    """A scene round a body of size 2. `size` and `shift` move the camera with the mesh. The extinction is per size."""
    at = np.asarray(shift, float)
    camera = {"position": list(np.asarray(eye, float) * size + at), "focal_point": list(np.asarray(target, float) * size + at),
              "up": [0, 1, 0], "vertical_fov_degrees": fov, "parallel_height": height * size}
    colors = colors or [[0, 0.1, 0.2, 0.8], [0.5, 0.8, 0.8, 0.7], [1, 0.9, 0.2, 0.1]]
    density = density or [[0, 0.2], [0.5, 0.1], [1, 3.0]]
    return {"camera": camera, "image": {"width": pixels[0], "height": pixels[1]}, "background": [0, 0, 0], "attribute": attribute,
            "transfer_function": {"domain": list(domain), "colors": colors, "density": [[t, d / size] for t, d in density]}}


def with_projection(of, projection):
    result = copy.deepcopy(of)
    camera = result["camera"]
    camera["projection"] = projection
    camera.pop("parallel_height" if projection == "perspective" else "vertical_fov_degrees")
    return result


@lru_cache
def ball():
    return meshes.ball()


@lru_cache
def lattice():
    return meshes.lattice()


def peak(width, at=0.4):
    """A transfer function that is 0 but for a peak of `width` of the domain: the narrower, the denser."""
    low, high = at - width / 2, at + width / 2
    return [[0, 0], [low, 0], [at, 0.3 / width], [high, 0], [1, 0]]


def with_outlier(value):
    values = lattice20().values["f"].copy()
    values[len(values) // 2 + 7] = value
    return lattice20().with_values(values)


@lru_cache
def lattice20():
    return meshes.lattice(20)


def far_vertex(distance):
    base = ball()
    points = np.concatenate([base.points, [[distance, 0, 0]]])
    return meshes.Mesh(points, base.cells).with_values(np.append(base.values["f"], 0.5))


def needles(distance):
    """A vertex of the ball's surface is far away: all of its cells reach there."""
    base = ball()
    index = int(np.argmin(np.linalg.norm(base.points - [0.97, 0.05, 0.05], axis=1)))
    return changed(base, index, position=np.array([1.0, 0.3, 0.1]) * distance)


def renamed(names):
    base = lattice()
    return meshes.Mesh(base.points, base.cells, base.kind, {name: base.values["f"] for name in names})


def twice_named():
    base = lattice()
    return meshes.Mesh(base.points, base.cells, base.kind, {"f": base.values["f"], "g": base.values["f"]}, names=("f", "f"))


def changed(mesh, index, values=None, position=None):
    points, of_points = mesh.points.copy(), mesh.values["f"].copy()
    if position is not None:
        points[index] = position
    if values is not None:
        of_points[index] = values
    return replace(mesh, points=points, values={"f": of_points})


def inverted(mesh):
    cells = mesh.cells.copy()
    cells[::3, [0, 1]] = cells[::3, [1, 0]]
    return replace(mesh, cells=cells)


def with_flat_cells(mesh):
    """Adds tetrahedra without volume: a corner twice, and four corners of a line."""
    more = np.array([[0, 1, 2, 2], [0, 0, 0, 0], [0, 1, 0, 1]])
    return replace(mesh, cells=np.concatenate([mesh.cells, more]))


def lattice_called_value():
    return lattice().with_values(lattice().values["f"], "value")


def squashed(mesh, axes):
    """A mesh whose points differ along the first `axes` axes only."""
    points = mesh.points.copy()
    points[:, axes:] = 0
    return replace(mesh, points=points)


def collapsed(count, axes):
    """Points that differ along the first `axes` axes only."""
    return mesh_of_points(squashed(meshes.points_only(count), axes).points)


def mesh_of_points(points):
    return meshes.Mesh(points, np.zeros((0, 4), int)).with_values(meshes.smooth(points))


def units():
    for exponent in (-300, -100, -36, -30, -20, -15, -14, -5, 0, 3, 7, 14, 15, 20, 27, 30, 36, 51, 100):
        size = 10.0**exponent
        refused = exponent < -36 or exponent > 50
        yield Case("Lengths", f"in units of 1e{exponent}", lambda s=size: ball().scaled(s), scene(min(size, 1e50)),
                   REFUSED if refused else BALL, quick=exponent in (-30, 0, 3, 36, 51), baseline=not refused,
                   says="smaller unit" if exponent < 0 else "1e50" if refused else "")
    for distance in (1e3, 1e9, 1e30):
        yield Case("Lengths", f"a vertex of no cell {distance:.0e} away", lambda d=distance: far_vertex(d), scene(), BALL,
                   quick=distance == 1e9, baseline=True)
    for distance in (1e2, 1e4, 1e6, 1e7, 1e8, 1e10, 1e12):
        yield Case("Lengths", f"a vertex of cells {distance:.0e} away", lambda d=distance: needles(d), scene(), 0.05,
                   quick=distance == 1e7, ways=WITHOUT_OCTANT)  # its splats have the size of the octree's leaves
    for cells in (1e3, 1e6, 1e9, 1e11, 1e13, 1e14, 1e15):
        shift = cells / 6
        bound = BALL if cells <= 1e13 else 2 * BALL  # 1e15: five steps of double precision in a cell
        yield Case("Lengths", f"{cells:.0e} cells from the origin", lambda s=shift: ball().scaled(1.0, s),
                   scene(shift=(shift,) * 3), bound, quick=cells == 1e11)


def values():
    for exponent in (-300, -60, -40, 45, 60, 99):
        factor = 10.0**exponent
        yield Case("Values", f"in units of 1e{exponent}",
                   lambda f=factor: ball().with_values(ball().values["f"] * f),
                   scene(domain=(-factor, factor)), BALL,
                   quick=exponent in (-300, 60), baseline=True)
    for outlier in (1e6, 1e8, 9.969209968386869e36, 1e45):
        yield Case("Values", f"one outlier of {outlier:.0e}", lambda v=outlier: with_outlier(v), scene(), 0.03,
                   quick=outlier > 1e30)
    yield Case("Values", "ten decades, seen at the lowest", lambda: meshes.decades_of(meshes.ball(20), 10),
               scene(domain=(1e-10, 1e-9), density=[[0, 3.0], [1, 0.0]]), 0.024)
    yield Case("Values", "ten decades on a logarithmic axis", lambda: meshes.decades_of(meshes.ball(20), 10),
               logarithmic(scene(domain=(1e-10, 1))), 0.005, quick=True)
    yield Case("Values", "one value everywhere", lambda: ball().with_values(np.full(len(ball().points), 0.5)), scene(), 0.015,
               quick=True)
    yield Case("Values", "0 and 1 at random", lambda: ball().with_values(np.random.default_rng(3).integers(0, 2, len(ball().points))),
               scene(domain=(0, 1)), 0.05,
               vtk=True)
    yield Case("Values", "a tenth missing (NaN)", lambda: changed(ball(), slice(None, None, 10), np.nan), scene(), 0.03, quick=True)
    yield Case("Values", "all missing", lambda: changed(ball(), slice(None), np.nan), scene(), REFUSED, quick=True,
               says="no point has a value")


def logarithmic(of):
    of["transfer_function"]["axis"] = "log"
    return of


def functions():
    for width, bound in ((1e-2, 0.07), (1e-3, 0.07), (1e-6, 0.07), (1e-9, 0.07)):
        yield Case("Functions", f"a peak of {width:.0e} of the domain", ball, scene(density=peak(width)), bound, vtk=True,
                   quick=width == 1e-2, exact_bound=ROUNDED if width < 1e-2 else 0.002,
                   ways=WITHOUT_OCTANT if width < 1e-3 else ())  # its splats have no value in the peak
    for extinction, bound in ((1e2, 0.04), (1e3, 0.05), (1e6, 0.11), (1e12, 0.18), (1e39, 0.18)):
        yield Case("Functions", f"extinction of {extinction:.0e} per size", ball,
                   scene(density=[[0, 0], [0.5, 0], [1, extinction]]), bound, vtk=True, quick=extinction == 1e3,
                   exact_bound=ROUNDED if extinction > 1e3 else 0.002)
    dense = [[t, d * 1e4] for t, d in peak(1e-2)]
    yield Case("Functions", "a peak of 1e-02 of the domain, dense", ball, scene(density=dense), 0.13, vtk=True,
               exact_bound=ROUNDED)
    yield Case("Functions", "a box", ball, scene(density=[[0, 0], [0.5, 0], [0.5, 3.0], [0.8, 3.0], [0.8, 0], [1, 0]]), 0.02,
               vtk=True, quick=True)
    for extinction in (1e12, 1e39, 1e99):
        yield Case("Functions", f"extinction of {extinction:.0e} everywhere", ball, scene(density=[[0, extinction], [1, extinction]]), 0.08,
                   quick=extinction == 1e39)
    white = [[0, 1, 1, 1], [1, 1, 1, 1]]
    for name, at_ends in (("jumps at the ends of the domain", [[0, 0], [0, 3], [1, 3], [1, 0]]),
                          ("three equal control points", [[0, 0.2], [0.5, 0.2], [0.5, 50], [0.5, 3], [1, 3]])):
        yield Case("Functions", name, ball, scene(domain=(-0.5, 0.5), colors=white, density=at_ends), 0.03, quick=True)
    for width in (1e-20, 1e-38, 1e-60):
        yield Case("Functions", f"a domain from 0 to {width:.0e}", ball, scene(domain=(0, width)), 0.02, quick=width == 1e-38,
                   exact_bound=0.002 if width > 1e-30 else 0.03)  # values are cut off
    for width in (1e20, 1e60):
        yield Case("Functions", f"a domain from {-width:.0e} to {width:.0e}", ball, scene(domain=(-width, width), density=[[0, 0], [1, 3]]), 0.015,
                   quick=width == 1e60)
    bright = [[0, 10, 20, 80], [1, 900, 200, 100]]
    yield Case("Functions", "colours of up to 900", ball, scene(colors=bright), 6.0, vtk=True, exact_bound=0.1)
    for ratio in (30, 100, 10**4, 10**8, 10**12):  # denser by as much as they are thinner
        for what, factor, bound in (("thin", ratio / 30, 0.003 if ratio <= 100 else 0.006), ("dense", max(3 * ratio, 300), 0.07)):
            yield Case("Functions", f"a plate of 1:{ratio:g}, {what}", lambda r=ratio: meshes.flat(r),
                       scene(density=[[0, 0.2 * factor], [1, 3.0 * factor]]), bound, quick=ratio >= 10**8, vtk=True,
                       ways=WITHOUT_OCTANT)  # to octant, a plate is balls as small as it is thin
    yield Case("Functions", "one tetrahedron", meshes.one_tetrahedron, scene(density=[[0, 0.5], [1, 2.0]]), 0.06, quick=True, vtk=True)
    yield Case("Functions", "a lattice along its axis", lattice, scene(eye=(0, 0, 5.0), height=2.57, density=[[0, 0.2], [1, 3.0]]), 0.02,
               projections=("orthographic",), vtk=True)
    yield Case("Functions", "a body in front of one 1000 times as large", meshes.two_bodies,
               scene(eye=(0, 0, 1.506), target=(0, 0, 1.5), height=0.004, density=[[0, 100], [1, 1000.0]]), 0.03,
               vtk=True)


def cameras():
    for fov, eye, bound in ((179, (0, 0, 0.3), 0.02), (120, (0, 0, 1.2), 0.01), (0.1, (1100, 800, 2000), 0.01),
                            (1e-4, (1.1e6, 8e5, 2e6), 0.01)):
        yield Case("Cameras", f"{fov} degrees", ball, scene(fov=fov, eye=eye), bound, projections=("perspective",), quick=fov == 179,
                   ways=WITHOUT_OCTANT if fov == 179 else ())  # a ball beside the eye is no circle
    vertex = lattice().points[665]
    for name, eye in (("on a vertex", vertex), ("on an edge", vertex + [0.1, 0, 0]), ("in a face", vertex + [0.1, 0.07, 0]),
                      ("in a cell", vertex + [0.1, 0.07, 0.03])):
        yield Case("Cameras", name, lattice, scene(eye=tuple(eye), target=(1.5, 1.0, 2.0), fov=60), 0.01, quick=name == "on a vertex")
    for far in (1e-6, 1e6):
        fov = 60 if far < 1 else 1.5e-4
        eye = np.array([0.0, 0, 1 + far]) if far < 1 else np.array([0.3, 0.2, 1.0]) * far
        yield Case("Cameras", f"{far:.0e} sizes away", ball, scene(eye=tuple(eye), fov=fov), 0.01)
    yield Case("Cameras", "1 x 1 pixels", ball, scene(pixels=(1, 1)), 0, exact=False, quick=True)
    for pixels in ((1, 4096), (4096, 3), (3000, 2)):
        narrow = min(pixels[1] / pixels[0], 1.0)  # the body is as wide as the picture
        yield Case("Cameras", f"{pixels[0]} x {pixels[1]} pixels", ball,
                   scene(pixels=pixels, fov=30 * narrow, height=2.6 * narrow), 0.01 if narrow == 1 else 0.015,
                   quick=pixels == (3000, 2))
    yield Case("Cameras", "16384 x 16384 pixels", ball, scene(pixels=(16384, 16384)), 0, exact=False, large=True,
               projections=("perspective",), ways=("splats",))


def shapes():
    yield Case("Meshes", "cells of nine decades", meshes.graded, scene(), 0.02, quick=True)
    yield Case("Meshes", "hanging nodes", meshes.hanging, scene(), 0.01, quick=True)
    visible = scene(domain=(0, 1), density=[[0, 0], [0.5, 0], [1, 3.0]])
    yield Case("Meshes", "a body in another, which is invisible", meshes.body_in_another, visible, 0.02, quick=True)
    opaque = scene(density=[[0, 500], [1, 5000]])
    yield Case("Meshes", "thin layers round a sphere", meshes.layers_round_a_sphere, opaque, 0.08, quick=True, ways=WITHOUT_OCTANT)
    yield Case("Meshes", "inverted cells", lambda: inverted(ball()), scene(), BALL, baseline=True)
    yield Case("Meshes", "flat cells among others", lambda: with_flat_cells(ball()), scene(), BALL, quick=True, baseline=True)
    yield Case("Meshes", "a position that is NaN", lambda: changed(ball(), 30, position=np.nan), scene(), 0.01)
    yield Case("Meshes", "prisms", lambda: meshes.in_prisms(lattice()), scene(), 0.005)
    yield Case("Meshes", "polyhedra", lambda: meshes.in_polyhedra(lattice()), scene(), 0.005, quick=True)
    for axes, what in ((0, "coincident"), (1, "collinear"), (2, "coplanar")):
        yield Case("Meshes", f"hexahedra whose corners are {what}", lambda n=axes: squashed(lattice(), n), scene(), REFUSED,
                   quick=axes == 2, says="no cell fills a volume")
    for suffix in (".npy", ".csv", ".vtp"):
        yield Case("Meshes", f"points of a lattice, {suffix}", lambda s=suffix: meshes.Points(lattice(), s),
                   scene(attribute="value" if suffix == ".npy" else "f"), 0.01, truth=lattice_called_value if suffix == ".npy" else lattice,
                   build=("--connectivity", "delaunay"), quick=suffix == ".csv")
    # Without cells there is no exact picture: they are drawn by the scene that svrender makes.
    yield Case("Meshes", "all points at one place", lambda: collapsed(100, 0), None, 0, exact=False,
               ways=WITHOUT_OCTANT)  # leaves of the octree without extent
    yield Case("Meshes", "points on a line", lambda: collapsed(100, 1), None, 0, exact=False)
    yield Case("Meshes", "points on a plane", lambda: collapsed(100, 2), None, 0, exact=False, quick=True)
    for count in (1, 2, 8):
        points = meshes.points_only(count).points
        yield Case("Meshes", f"{count} points", lambda p=points: mesh_of_points(p), None, 0, exact=False, quick=count == 1)
    yield Case("Meshes", "300 attributes", lambda: renamed([f"a{i}" for i in range(299)] + ["f"]), scene(), 0.005)
    yield Case("Meshes", "a name of 10 kB", lambda: renamed(["n" * 10000]), scene(attribute="n" * 10000), 0.005)
    yield Case("Meshes", "a name with line breaks", lambda: renamed(["a\nb"]), scene(attribute="a\nb"), 0.005, quick=True)
    yield Case("Meshes", "equal names", twice_named, scene(), REFUSED, quick=True, says="are called")
    yield Case("Meshes", "an empty name", lambda: renamed([""]), scene(attribute=""), REFUSED, quick=True,
               says="has no name")


def all_cases():
    return [*units(), *values(), *functions(), *cameras(), *shapes()]
