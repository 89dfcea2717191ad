"""Sections 2 and 4.1, and figure 4: reductions."""

from textwrap import indent

from .measure import MESHES, VIEWS, paragraph, row, show, table
from .plots import draw_error_curves
from .sheets import Sheet

METHODS = ("octree", "kdtree", "mis")
LEAVES = (8, 12, 16, 25, 64)
PICTURED_LEAVES = (8, 25, 64)
SPLATS = (2000, 5000, 10000, 20000)
TOLERANCES = (2, 5, 10, 20)


def reductions(paper):
    """Section 4.1: the reductions beside each other."""
    table(
        "mesh",
        "reduction",
        "CPU s",
        "points of the resolutions",
        "share that stays, each reduction",
        "points of all resolutions, % of the finest",
        "file MB",
    )
    for mesh in MESHES:
        for method in METHODS:
            file, summary, seconds = paper.build(mesh, "--reduction", method)
            counts = summary["resolutions"]
            shares = ", ".join(f"{a / b:.2f}" for a, b in zip(counts[:-1], counts[1:]))
            total = f"{100 * sum(counts) / counts[-1]:.0f}"
            megabytes = f"{file.stat().st_size / 1e6:.1f}"
            row(mesh, method, f"{seconds:.1f}", ", ".join(map(str, counts)), shares, total, megabytes)
    compare_errors(paper)


def compare_errors(paper):
    paragraph("""RMSE against the exact picture with that many splats, chosen by expected error, kernel `moments`. Last,
        the RMSE of the kernel `octant` with whole resolutions:""")
    table("view", "reduction", *(f"{n} splats" for n in SPLATS), "octant: splats, RMSE of each resolution")
    sheet = Sheet()
    for view in VIEWS:
        scene = paper.scene(view)
        sheet.new_row()
        sheet.add(f"{view}, exact", paper.truth(view), scene)
        for method in METHODS:
            file, summary, _ = paper.build(view, "--reduction", method)
            drawn = [paper.render(file, scene, "--splats", n, "--sampling", 1)[0] for n in SPLATS]
            sheet.add(f"{method}, {SPLATS[0]} splats", drawn[0], scene)
            whole = []
            for resolution, count in enumerate(summary["resolutions"]):
                options = ("--kernel", "octant", "--resolution", resolution, "--sampling", 1)
                whole.append(f"{count}: {paper.error(paper.render(file, scene, *options)[0], view):.3f}")
            row(view, method, *(f"{paper.error(picture, view):.4f}" for picture in drawn), ", ".join(whole))
    sheet.write(path := paper.pictures / "paper-reductions.png")
    show(path, "the reductions at equal splats")


def leaf(paper):
    """Section 3.4, figure 4: N, the points in a leaf."""
    print("\n`svbuild --leaf 5`, the paper's other N:")
    refused = paper.attempt("svbuild", paper.mesh("bluntfin"), "-o", paper.new_file(".svol"), "--leaf", 5)
    print("\n" + indent(f"{refused.stderr.strip()}\n(exit code {refused.returncode})", 4 * " "))
    table(
        "view",
        "N",
        "share that stays, first reduction",
        "file MB",
        "octant: RMSE at 5 %",
        "splats",
        "moments: RMSE at 5 %",
        "splats",
        "moments: RMSE of 5000 splats",
        "of 20,000",
    )
    curves, sheet = {}, Sheet()
    for view in VIEWS:
        for n in LEAVES:
            file, summary, _ = paper.build(view, "--leaf", str(n))
            counts = summary["resolutions"]
            cells = [view, n, f"{counts[-2] / counts[-1]:.2f}", f"{file.stat().st_size / 1e6:.1f}"]
            for kernel in ("octant", "moments"):
                curve = curves[view, kernel, n] = error_curve(paper, view, file, kernel)
                _, splats, error = curve[TOLERANCES.index(5)]
                cells += [f"{error:.4f}", splats]
            for splats in (5000, 20000):
                picture, _ = paper.render(file, paper.scene(view), "--splats", splats, "--sampling", 1)
                cells.append(f"{paper.error(picture, view):.4f}")
            row(*cells)
    for kernel in ("octant", "moments"):
        add_leaves(paper, sheet, "bluntfin", kernel, curves)
    sheet.write(path := paper.pictures / "paper-leaf.png")
    show(path, "N = 8, 25 and 64 at a tolerance of 5 %, beside the exact picture")
    draw_error_curves(curves, path := paper.pictures / "paper-leaf-curves.png")
    show(path, "RMSE against splats for each N")


def error_curve(paper, view, file, kernel):
    """Returns [(picture, splats, RMSE)] of each tolerance, fine to coarse."""
    curve = []
    for tolerance in TOLERANCES:
        options = ("--kernel", kernel, "--tolerance", tolerance, "--sampling", 1)
        picture, stats = paper.render(file, paper.scene(view), *options)
        curve.append((picture, stats["splats"], paper.error(picture, view)))
    return curve


def add_leaves(paper, sheet, view, kernel, curves):
    sheet.new_row()
    sheet.add(f"{view}, exact", paper.truth(view), paper.scene(view))
    for n in PICTURED_LEAVES:
        picture, splats, _ = curves[view, kernel, n][TOLERANCES.index(5)]
        sheet.add(f"{kernel}, N = {n}, {splats} splats", picture, paper.scene(view))
