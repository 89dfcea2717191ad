"""Figure 9: large data. Section 5: the parts of the file, and the share of it that pictures read.

Builds meshes of tens of millions of tetrahedra, and 20 million points, by every reduction. Takes some ten minutes and
5 GB of temporary files.
"""

import json
import mmap
import shutil
import struct
from pathlib import Path
from typing import NamedTuple

from .. import common
from .measure import VIEWS, row, show, table
from .sheets import Sheet

SCENE = Path(__file__).resolve().with_name("large.json")
POINTS = "gen:points:count=2e7,distribution=vortex,type=float32"
MEMORY = "1G"
# Enough memory to draw every picture as requested, so that errors are those of the tolerance.
ROOM = ("--memory", "2G", "--gpu-memory", "2G")
KERNELS = ("moments", "octant")
TOLERANCES = (5, 1, 0.5)
# The columns that a kernel reads.
COLUMNS = {"moments": ("centroid", "moments", "value_moments"), "octant": ("position", "octant", "value")}


class Mesh(NamedTuple):
    name: str
    source: str | Path  # input of svbuild and svtruth
    scene: Path | None  # None: only built
    options: tuple = ()  # of svbuild


def folder(paper):
    """Returns the folder for files that several parts use."""
    path = paper.work / "large"
    path.mkdir(exist_ok=True)
    return path


def meshes(paper):
    wing, refined = paper.shared / "data/wing.vtu", folder(paper) / "wing-refined"
    if not refined.exists():
        paper.run("svgen", "refine", wing, "--levels", 2, "--attribute", "p", "-o", refined)
    return (
        Mesh("generated", "gen:mesh:cells=1.83e7", SCENE),
        Mesh("wing", wing, paper.scene("wing"), ("--attribute", "p")),
        Mesh("wing-refined", refined, paper.scene("wing")),
    )


def large_meshes(paper):
    return [mesh for mesh in meshes(paper) if mesh.name != "wing"]


def measured(paper, program, *arguments):
    """Runs a program. Returns its JSON, with wall and CPU seconds and the peak bytes of memory."""
    output, took = common.measured(paper.programs / program, *arguments)
    return json.loads(output) | took


def made_once(path, make):
    """Calls `make` if the file is missing. Returns the path and the result of `make`, then or earlier."""
    report = path.with_name(f"{path.name}.json")
    if not path.exists():
        report.write_text(json.dumps(make()))
    return path, json.loads(report.read_text())


def build(paper, mesh, *options):
    """Returns the file, and svbuild's summary with its time and memory."""
    options = (*mesh.options, *options)
    path = folder(paper) / f"{mesh.name.partition(':')[0]}{''.join(options)}.svol"
    command = ("svbuild", mesh.source, "-o", path, "--memory", MEMORY, "--drop-cells", "--json", *options)
    return made_once(path, lambda: measured(paper, *command))


def truth(paper, mesh):
    """Returns the exact picture, and svtruth's summary with its time and memory."""
    path = folder(paper) / f"{mesh.name}.exr"
    command = ("svtruth", mesh.source, "--scene", mesh.scene, "-o", path, "--json")
    return made_once(path, lambda: measured(paper, *command))


def describe(built, file):
    """Returns a table's cells that describe a build."""
    took = [f"{built['wall']:.1f}", f"{built['cpu']:.1f}", f"{built['peak'] / 2**20:.0f}"]
    return [*took, ", ".join(map(str, built["resolutions"])), f"{file.stat().st_size / 1e6:.1f}"]


def compare_builds(paper):
    print(f"Building with `--memory {MEMORY}`, and the exact picture by `svtruth`:")
    table(
        *("mesh", "tetrahedra", "s", "CPU s", "peak MiB", "points of the resolutions", "file MB"),
        *("exact picture s", "of it drawing", "peak MiB", "segments a pixel"),
    )
    for mesh in meshes(paper):
        file, built = build(paper, mesh)
        _, exact = truth(paper, mesh)
        drawing = [f"{exact['wall']:.1f}", f"{exact['seconds']:.1f}", f"{exact['peak'] / 2**20:.0f}"]
        segments = f"{exact['segments_per_pixel']:.0f}"
        row(mesh.name, built["census"]["tetrahedra"], *describe(built, file), *drawing, segments)


def draw(paper, mesh, kernel, *choice):
    """Draws a picture. Returns it, its number of splats, and a row's cells that describe it."""
    file, _ = build(paper, mesh)
    exact, _ = truth(paper, mesh)
    options = ("--kernel", kernel, *choice, *ROOM)
    common.forget(file)
    _, cold = paper.render(file, mesh.scene, *options)
    picture, steady = paper.render(file, mesh.scene, *options, "--repeat", paper.frames)
    splats = str(cold["splats"])
    if "tolerance" in cold and cold["effective_tolerance"] > cold["tolerance"]:
        splats += f" (at {cold['effective_tolerance']:.2g} %)"
    times = f"{1000 * steady['seconds']['frame']:.0f}", f"{cold['first_image_seconds']:.2f}"
    read = f"{cold['bytes_read'] / 1e6:.1f}", f"{100 * cold['bytes_read'] / cold['file_bytes']:.1f}"
    return picture, cold["splats"], [splats, f"{paper.rmse(picture, exact):.4f}", *times, *read]


def compare_pictures(paper):
    print("\nPictures, by tolerance and by expected error, against the exact one:")
    table("mesh", "kernel", "asked for", "splats", "RMSE", "frame ms", "of a cold file s", "MB read", "% of the file")
    sheets = {mesh.name: Sheet() for mesh in large_meshes(paper)}
    for mesh in meshes(paper):
        sheet = sheets.get(mesh.name, Sheet())
        for kernel in KERNELS:
            sheet.new_row()
            sheet.add(f"{mesh.name}, exact", truth(paper, mesh)[0], mesh.scene)
            for tolerance in TOLERANCES:
                picture, splats, cells = draw(paper, mesh, kernel, "--tolerance", tolerance)
                row(mesh.name, kernel, f"{tolerance} %", *cells)
                sheet.add(f"{kernel}, {tolerance} %, {splats} splats", picture, mesh.scene)
                _, _, cells = draw(paper, mesh, kernel, "--splats", splats)
                row(mesh.name, kernel, "as many splats", *cells)
    for name, sheet in sheets.items():
        sheet.write(path := paper.pictures / f"paper-large-{name}.png")
        show(path, f"{name}: both kernels at 5, 1 and .5 %, beside the exact picture")


def first_pictures(paper):
    print("\nThe first picture of a cold file (`--progress-frames`):")
    table("mesh", "kernel", "ms from the program's start", "KiB read", "splats")
    for mesh in meshes(paper):
        file, _ = build(paper, mesh)
        for kernel in KERNELS:
            frames = folder(paper) / "frames"
            frames.mkdir()
            common.forget(file)
            _, stats = paper.render(file, mesh.scene, "--kernel", kernel, "--tolerance", 5, "--progress-frames", frames)
            shutil.rmtree(frames)
            first = stats["progress_frames"][0]
            cells = f"{1000 * first['seconds']:.0f}", f"{first['bytes_read'] / 1024:.0f}", first["splats"]
            row(mesh.name, kernel, *cells)


def compare_reductions(paper):
    print(f"\nThe reductions with `--memory {MEMORY}`, and RMSE by expected error, kernel `moments`:")
    counts = (10000, 100000, 1000000)
    build_columns = ("s", "CPU s", "peak MiB", "points of the resolutions", "file MB")
    table("input", "reduction", *build_columns, *(f"{count} splats" for count in counts))
    for mesh in (*large_meshes(paper), Mesh(POINTS, POINTS, None, ("--connectivity", "boxes"))):
        for reduction in ("octree", "kdtree", "mis"):
            # The octree is svbuild's default, so its builds of the meshes exist already.
            file, built = build(paper, mesh, *(() if reduction == "octree" else ("--reduction", reduction)))
            errors = [""] * len(counts)
            if mesh.scene:
                exact, _ = truth(paper, mesh)
                choices = [("--splats", count, "--sampling", 1, *ROOM) for count in counts]
                pictures = [paper.render(file, mesh.scene, *choice)[0] for choice in choices]
                errors = [f"{paper.rmse(picture, exact):.4f}" for picture in pictures]
            row(mesh.name if mesh.scene else f"`{mesh.name}`", reduction, *describe(built, file), *errors)
            if reduction != "octree" or not mesh.scene:
                file.unlink()


def large(paper):
    """Figure 9: a generated mesh, the largest real mesh at hand, and the real mesh refined."""
    compare_builds(paper)
    compare_pictures(paper)
    first_pictures(paper)
    compare_reductions(paper)


def chunk_bytes(file, info):
    """Returns the packed bytes of chunks, [column, resolution, segment], from the directory (spec, section 5)."""
    counts = info["resolution_counts"]
    groups = [-(-(n - before) // most) for before, n, most in zip([0, *counts], counts, info["points_per_chunk"])]
    root = next(section["offset"] for section in info["sections"] if section["kind"] == "directory_root")
    sizes = []
    with open(file, "rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as data:
        (pages,) = struct.unpack_from("<Q", data, root)
        for page in range(pages):
            offset, count, _ = struct.unpack_from("<QQQ", data, root + 8 + 24 * page)
            sizes += [entry[1] for entry in struct.iter_unpack("<QIIffQ", data[offset + 8 : offset + count])]
    sums, entry = {}, iter(sizes)
    for resolution in range(len(counts)):
        for segment in range(resolution + 1):
            for _ in range(groups[segment]):
                for column, kind in enumerate(info["columns"]):
                    if kind["scope"] == "resolution" or segment == resolution:
                        key = column, resolution, segment
                        sums[key] = sums.get(key, 0) + next(entry)
    if sum(sums.values()) != sum(column["packed_bytes"] for column in info["columns"]):
        raise ValueError(f"{file}: its directory and svinfo disagree")
    return sums


def bytes_a_splat(info, sums, kernel, attribute):
    """Returns the average bytes of a splat in the columns that the kernel reads, [resolution]."""
    wanted = [
        number
        for number, column in enumerate(info["columns"])
        if column["kind"] in COLUMNS[kernel] and column.get("attribute", attribute) == attribute
    ]

    def belongs(column, of, resolution):
        return of == resolution if info["columns"][column]["scope"] == "resolution" else of <= resolution

    averages = []
    for resolution, points in enumerate(info["resolution_counts"]):
        own = (size for (column, of, _), size in sums.items() if column in wanted and belongs(column, of, resolution))
        averages.append(sum(own) / points)
    return averages


def parts_of(info, sums):
    """Yields names and bytes of a file's parts in their order."""
    sections = sorted(info["sections"], key=lambda section: section["offset"])
    yield "superblock and section table", sections[0]["offset"]
    for section in sections:
        if section["kind"] != "rows":
            yield section["kind"].replace("_", " "), section["bytes"]
            continue
        before = 0
        for resolution, points in enumerate(info["resolution_counts"]):
            size = sum(size for (_, of, _), size in sums.items() if of == resolution)
            yield f"rows of resolution {resolution}: {points} points, {points - before} of them new", size
            before = points
    yield "footer", 32


def show_layout(name, info, sums):
    total, preamble, offset = info["bytes"], info["preamble_bytes"], 0
    print(f"\n```\n{name}: {total} bytes, {info['points']} points\n\n{'offset':>11} {'bytes':>11} {'%':>6}")
    for part, size in parts_of(info, sums):
        mark, bar = "|" if offset < preamble else " ", "#" * round(50 * size / total)
        print(f"{offset:>11} {size:>11} {100 * size / total:>6.2f} {mark} {part:<60} {bar}".rstrip())
        offset += size
    if offset != total:
        raise ValueError(f"{name}: parts of {offset} bytes in {total}")
    print(f"\n| the preamble, {preamble} bytes: the first picture\n# 2 %\n```")


def bytes_read(paper):
    """Section 5: the sizes of the file's parts, and the bytes that pictures read."""
    files = [(view, paper.build(view)[0], paper.scene(view)) for view in VIEWS]
    files += [(mesh.name, build(paper, mesh)[0], mesh.scene) for mesh in large_meshes(paper)]
    opened = []
    for name, file, scene in files:
        info = json.loads(paper.run("svinfo", file, "--json"))
        opened.append((name, file, scene, info, chunk_bytes(file, info)))
    for name, _, _, info, sums in opened:
        if name in ("bluntfin", "wing-refined"):
            show_layout(f"{name}.svol", info, sums)

    table("view", "kernel", "tolerance %", "splats", "MB read", "% of the file", "MB of the splats", "read over these")
    for name, file, scene, info, sums in opened:
        attribute = json.loads(scene.read_text())["attribute"]
        for kernel in KERNELS:
            averages = bytes_a_splat(info, sums, kernel, attribute)
            for tolerance in (20, 10, 5, 1, 0.5):
                _, stats = paper.render(file, scene, "--kernel", kernel, "--tolerance", tolerance, *ROOM)
                read, own = stats["bytes_read"], sum(a * n for a, n in zip(averages, stats["splats_by_resolution"]))
                share, cells = f"{100 * read / stats['file_bytes']:.1f}", [name, kernel, tolerance, stats["splats"]]
                row(*cells, f"{read / 1e6:.2f}", share, f"{own / 1e6:.2f}", f"{read / own:.1f}")
