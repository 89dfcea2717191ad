"""Section 3.2, figures 2, 3 and 6: gradients and lighting."""

import json

import numpy

from .fields import Splats, Tetrahedra, Vertices, angles, weighted, write_grid
from .measure import MESHES, VIEWS, paragraph, row, show, table
from .sheets import Sheet
from .slices import Figure, Plane, exact_slices, splat_slice

KERNELS = ("octant", "moments")
SLOPE = numpy.array([2.0, -1.0, 3.0])  # gradient of the linear field on the meshes' points
PLANES = {"bluntfin": Plane(1.5, (-6, 0), (8, 7)), "post": Plane(2.4, (-6, -4), (8, 4))}
AMBIENT, DIFFUSE = 0.3, 0.7  # of a scene's "lighting": true
SHELLS = {  # thin shells of bluntfin round two values
    "transfer_function": {
        "domain": [0.42384, 4.00934],
        "colors": [[0, 0.2, 0.5, 0.8], [0.3, 0.2, 0.5, 0.8], [0.4, 0.9, 0.5, 0.2], [1, 0.9, 0.5, 0.2]],
        "density": [[0.235, 0], [0.25, 8], [0.265, 0], [0.42, 0], [0.45, 8], [0.48, 0]],
    }
}
COARSER = 2  # resolutions below the finest, in the slices


def gradients(paper):
    """Figure 2, in numbers and as slices."""
    attributes = {mesh: json.loads(paper.scene(mesh).read_text())["attribute"] for mesh in MESHES}
    meshes = {mesh: Tetrahedra(paper.mesh(mesh), attribute) for mesh, attribute in attributes.items()}
    paragraph("""Degrees between each point's gradient and the exact one, which is the mean over the point's share of
        the mesh's tetrahedra. Mean and median are weighted by mass, the third figure by mass times the exact gradient's
        length. The rows `(tetrahedra)` compare the gradients of these tetrahedra themselves. The last two columns are
        the mean for a linear field on the same points, weighted by mass.""")
    sums = ("mean", "median", "by length")
    columns = [f"{which}: {what}" for which in ("moments", "column") for what in sums]
    table("mesh", "points joined by", *columns, "linear: moments", "linear: column")
    for name in MESHES:
        compare_angles(paper, name, meshes[name], attributes[name])
    paragraph("""The slices: degrees to the gradient of the tetrahedron at each pixel, weighted by its length.
        *Interpolated* are the points' exact means, interpolated between the points.""")
    columns = [f"{which}: {what}" for which in ("interpolated", "moments", "column") for what in ("mean", "median")]
    table("mesh", "plane", "splats", *columns)
    figures = [draw_slices(paper, name, meshes[name], attributes[name], plane) for name, plane in PLANES.items()]
    for name, path in zip(PLANES, figures):
        show(path, f"{name}: gradient and contours on a plane, and how far the gradient is off")


def export(paper, file, attribute, resolution=None):
    out = paper.new_file(".vtu")
    chosen = () if resolution is None else ("--resolution", resolution)
    paper.run("svexport", file, "-o", out, "--attribute", attribute, *chosen)
    return Splats(out, attribute)


def compare_angles(paper, name, mesh, attribute):
    vertices = Vertices(mesh)
    row(name, "(tetrahedra)", *(f"{cell:.1f}" for cell in spread(mesh, vertices)), *5 * [""])
    linear = mesh.points @ SLOPE
    grid, points = paper.work / f"{name}-linear.vtu", paper.work / f"{name}-points.npy"
    write_grid(mesh, {attribute: mesh.values, "linear": linear}, grid)
    numpy.save(points, numpy.column_stack([vertices.places, vertices.values, vertices.places @ SLOPE]))
    columns = ("--columns", f"x,y,z,{attribute},linear")
    ways = {
        "the mesh": (grid,),
        "Delaunay": (points, *columns, "--connectivity", "delaunay"),
        "nothing": (points, *columns, "--connectivity", "none"),
    }
    for way, options in ways.items():
        file, _, _ = paper.build(*options)
        splats = export(paper, file, attribute)
        at = vertices.nearest(splats.points)
        exact, masses = vertices.gradients[at], vertices.masses[at]
        lengths = numpy.linalg.norm(exact, axis=1)
        cells = []
        for found in (splats.gradients, splats.directions):
            cells += averages(angles(exact, found), masses, lengths)
        straight = export(paper, file, "linear")
        along = numpy.broadcast_to(SLOPE, straight.points.shape)
        cells += [weighted(angles(along, found), masses)[0] for found in (straight.gradients, straight.directions)]
        row(name, way, *(f"{cell:.1f}" for cell in cells))


def averages(angle, masses, lengths):
    return [*weighted(angle, masses), weighted(angle, masses * lengths)[0]]


def spread(mesh, vertices):
    """Returns the averages of the angles between each vertex's mean gradient and those of its tetrahedra."""
    exact = vertices.gradients[vertices.corners]
    angle = angles(exact, numpy.broadcast_to(mesh.gradients[:, None], exact.shape))
    masses = numpy.broadcast_to(mesh.volumes[:, None] / 4, angle.shape)
    return averages(angle.ravel(), masses.ravel(), numpy.linalg.norm(exact, axis=-1).ravel())


def draw_slices(paper, name, mesh, attribute, plane):
    file, summary, _ = paper.build(name)
    finest = len(summary["resolutions"]) - 1
    vertices = Vertices(mesh)
    exact, smooth = exact_slices(mesh, vertices.gradients[vertices.number], plane)
    levels = [export(paper, file, attribute, r) for r in (finest, finest - COARSER)]
    by_moments = [splat_slice(splats, splats.gradients, plane) for splats in levels]
    by_formula = [splat_slice(splats, splats.directions, plane) for splats in levels]
    figure = Figure(plane, exact)
    figure.add_gradient(exact, f"{name}, {attribute}, z = {plane.z}: exact")
    for splats, part in zip(levels, by_moments):
        figure.add_gradient(part, f"moments, {len(splats.masses)} splats")
    figure.add_angle(by_formula[0], f"the formula, {len(levels[0].masses)} splats")
    for splats, part in zip(levels, by_moments):
        figure.add_angle(part, f"moments, {len(splats.masses)} splats")
    for splats, *parts in zip(levels, by_moments, by_formula):
        cells = [f"{number:.1f}" for part in (smooth, *parts) for number in figure.angle(part)]
        row(name, f"z = {plane.z}", len(splats.masses), *cells)
    figure.write(path := paper.pictures / f"paper-gradient-{name}.png")
    return path


def lighting(paper):
    """Figures 3 and 6: lighting, with both kernels."""
    table("view", "kernel", "tolerance %", "splats", "unlit: RMSE", "lit: RMSE", "light, of the exact")
    sheet = Sheet(170)
    for view, changes in ((VIEWS[0], SHELLS), *((view, {}) for view in VIEWS)):
        light_view(paper, view, f"{view}, shells" if changes else view, changes, sheet)
    paragraph("""The factor of light over a point's share of the mesh, weighted by extinction: the mean of its
        tetrahedra's factors, and the factor of their mean gradient:""")
    table("view", "each tetrahedron's", "of the mean gradient", "share")
    for view in VIEWS:
        each, mean = light_factors(json.loads(paper.scene(view).read_text()), paper.mesh(view))
        row(view, f"{each:.3f}", f"{mean:.3f}", f"{mean / each:.3f}")
    sheet.write(path := paper.pictures / "paper-lighting.png")
    show(path, "without and with light, both kernels at 5 %, beside the exact pictures")


def light_view(paper, view, name, changes, sheet):
    file, _, _ = paper.build(view)
    scenes = [paper.changed_scene(view, changes | {"lighting": lit}) for lit in (False, True)]
    truths = []
    for scene in scenes:
        truths.append(paper.new_file(".exr"))
        paper.run("svtruth", paper.mesh(view), "--scene", scene, "-o", truths[-1])
    sheet.new_row()
    sheet.add(f"{name}, exact", truths[0], scenes[0])
    sheet.add("lit, exact", truths[1], scenes[1])
    for kernel in KERNELS:
        for tolerance in (0, 5):
            options = ("--kernel", kernel, "--tolerance", tolerance, "--sampling", 1)
            drawn = [paper.render(file, scene, *options) for scene in scenes]
            pairs = [paper.difference(truth, picture) for truth, (picture, _) in zip(truths, drawn)]
            exact, light = pairs[1]["mean"]
            errors = (f"{pair['rmse']:.4f}" for pair in pairs)
            row(name, kernel, tolerance, drawn[0][1]["splats"], *errors, f"{light / exact:.3f}")
        sheet.add(f"{kernel}, {tolerance} %", drawn[0][0], scenes[0])
        sheet.add(f"lit, {kernel}, {tolerance} %", drawn[1][0], scenes[1])


def light_factors(scene, path):
    """Returns the mean light factors over the volume, by extinction, seen along the camera's line of sight: of each
    tetrahedron's gradient, and of the points' mean gradients."""
    mesh = Tetrahedra(path, scene["attribute"])
    vertices = Vertices(mesh)
    sight = numpy.subtract(scene["camera"]["focal_point"], scene["camera"]["position"])
    sight = sight / numpy.linalg.norm(sight)

    def factor(vectors):
        cosines = numpy.abs(numpy.cos(numpy.radians(angles(vectors, numpy.broadcast_to(sight, vectors.shape)))))
        return AMBIENT + DIFFUSE * numpy.where(numpy.isnan(cosines), 1, cosines)

    low, high = scene["transfer_function"]["domain"]
    places, densities = numpy.transpose(scene["transfer_function"]["density"])
    extinctions = numpy.interp((vertices.values - low) / (high - low), places, densities)
    each = vertices.sum_up(mesh.volumes / 4 * factor(mesh.gradients))
    mean = vertices.masses * factor(vertices.gradients)
    return [extinctions @ of_all / (extinctions @ vertices.masses) for of_all in (each, mean)]
