"""Sections 3.4 and 4.2: tolerance, distance, sorting."""

import json

from .measure import VIEWS, milliseconds, row, show, table
from .sheets import Sheet

KERNELS = ("octant", "moments")
TOLERANCES = (0, 1, 5, 10, 20)


def tolerances(paper):
    """Section 4.2, figures 5 and 8."""
    table("view", "kernel", "tolerance %", "splats", "frames/s", "RMSE")
    sheet = Sheet(170)
    for view in VIEWS:
        file, _, _ = paper.build(view)
        scene = paper.scene(view)
        for kernel in KERNELS:
            sheet.new_row()
            sheet.add(f"{view}, exact", paper.truth(view), scene)
            for tolerance in TOLERANCES:
                options = ("--kernel", kernel, "--tolerance", tolerance, "--repeat", paper.frames)
                picture, stats = paper.render(file, scene, *options)
                if tolerance > 0:
                    sheet.add(f"{kernel}, {tolerance} %", picture, scene)
                frequency = f"{1 / stats['seconds']['frame']:.1f}"
                row(view, kernel, tolerance, stats["splats"], frequency, f"{paper.error(picture, view):.4f}")
    sheet.write(path := paper.pictures / "paper-tolerances.png")
    show(path, "tolerances of 1, 5, 10 and 20 % with both kernels, beside the exact picture")


def far_away(paper, view, factor):
    """Writes the view's scene with the camera `factor` times as far. Returns its path."""
    camera = json.loads(paper.scene(view).read_text())["camera"]
    eye, focus = camera["position"], camera["focal_point"]
    camera["position"] = [f + factor * (e - f) for e, f in zip(eye, focus)]
    return paper.changed_scene(view, {"camera": camera})


def relative_rmse(paper, file, view, scene, tolerance):
    """Returns the number of splats, and the RMSE against all points over the root mean square of these."""
    transfer = json.loads(paper.scene(view).read_text())["transfer_function"]
    camera = json.loads(scene.read_text())["camera"]
    empty = {"camera": camera, "transfer_function": transfer | {"density": [[0, 0], [1, 0]]}}
    black, _ = paper.render(file, paper.changed_scene(view, empty), "--tolerance", 20)
    exact, _ = paper.render(file, scene, "--tolerance", 0, "--sampling", 1)
    picture, stats = paper.render(file, scene, "--tolerance", tolerance, "--sampling", 1)
    return stats["splats"], paper.rmse(picture, exact) / paper.rmse(black, exact)


def small(paper):
    """Section 4.2: 20 % at full size, and 1 % at 1/400 of the area."""
    table(
        "view",
        "at full size, 20 %: splats",
        "relative RMSE",
        "20 times as far, 1 %: splats",
        "relative RMSE",
        "20 times as far, 20 %: splats",
        "relative RMSE",
    )
    for view in ("bluntfin", "post"):
        file, _, _ = paper.build(view)
        cells = [view]
        near, far = paper.scene(view), far_away(paper, view, 20)
        for scene, tolerance in ((near, 20), (far, 1), (far, 20)):
            splats, error = relative_rmse(paper, file, view, scene, tolerance)
            cells += [splats, f"{error:.3f}"]
        row(*cells)


def sorting(paper):
    """Section 3.4: the gain of sorting."""
    sorts = ("none", "axis", "exact")
    columns = (f"{sort}: {what}" for sort in sorts for what in ("RMSE", "ms"))
    table("view", "kernel", "tolerance %", *columns, "none against exact", "axis against exact")
    for view in ("bluntfin", "bluntfin-close", "post", "post-close", "wing", "wing-wake"):
        file, _, _ = paper.build(view.split("-")[0])
        for kernel in KERNELS:
            for tolerance in (0, 5):
                cells, pictures = [view, kernel, tolerance], []
                for sort in sorts:
                    options = ("--kernel", kernel, "--tolerance", tolerance, "--sort", sort, "--sampling", 1)
                    picture, stats = paper.render(file, paper.scene(view), *options, "--repeat", paper.frames)
                    pictures.append(picture)
                    cells += [f"{paper.error(picture, view):.4f}", milliseconds(stats)]
                row(*cells, *(f"{paper.rmse(picture, pictures[-1]):.4f}" for picture in pictures[:-1]))
