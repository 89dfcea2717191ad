"""Measures how svbuild builds larger and larger volumes; writes the section Builds of docs/scale.md.

  bench/svbench scale                                   builds each input once
  bench/svbench scale --against OLD/bin                 compares two versions, which take turns; prints a table
  bench/svbench scale --against OLD/bin --npy 1e6,2e7   compares them by these inputs only

Inputs are svgen's and are made while they are read (gen:...), so they take no disk space. The times include making
them, except for files. Each build runs alone; its file is removed. Needs Python's standard library only.
"""

import json
import os
import statistics
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

from .common import ROOT, add_programs, count, measured, output_of, processor, table_head, wrapped, write_section

POINTS = ["uniform", "vortex", "half-tiny", "equal", "two-clusters", "line", "layer", "clusters"]
IN_A_FILE = " points in a .npy"
# Kinds of inputs: what they are, and the sizes that are built without --against and with it.
KINDS = {
    "counts": ("scattered points", "1e6,1e7,1e8", ""),
    "npy": ("scattered points in a file", "1e8", "2e7"),
    "cells": ("tetrahedra of partitioned meshes", "6e6,6e7", "2e7"),
    "hard": ("points of the hard distributions", "1e7", ""),
    "delaunay": ("scattered points to join by Delaunay tetrahedra", "4e6", "1e5"),
    "none": ("scattered points with Voronoi cells", "", "1e5"),
}
TITLES = (
    *("input", "`--memory`", "points", "resolutions", "seconds", "speed", "CPU microseconds a point", "peak MiB"),
    *("disk space while it runs, bytes a point", "bytes a point of the file"),
)


class Disk:
    """Measures the largest fall of a file system's free space, sampled twenty times a second."""

    def __init__(self, folder):
        self.folder, self.most, self.done = folder, 0, threading.Event()
        self.before = self.free()
        self.thread = threading.Thread(target=self.watch)
        self.thread.start()

    def free(self):
        status = os.statvfs(self.folder)
        return status.f_bavail * status.f_frsize

    def watch(self):
        while not self.done.wait(0.05):
            self.most = max(self.most, self.before - self.free())

    def stop(self):
        self.done.set()
        self.thread.join()
        return self.most


@contextmanager
def make_input(source, svgen, work):
    """Yields svbuild's argument for `source`: the source, or a .npy file that exists while the context is open."""
    if not source.endswith(IN_A_FILE):
        yield source
        return
    path = Path(work) / "points.npy"
    recipe = ["--count", source.removesuffix(IN_A_FILE), "--distribution", "vortex", "--float32"]
    output_of(svgen, "points", *recipe, "--force", "-o", path)
    yield str(path)
    path.unlink()


def build(svbuild, source, memory, options, work):
    """Builds `source`. Returns svbuild's report with wall and CPU seconds, peak memory and disk space in bytes."""
    output = Path(work) / "volume.svol"
    disk = Disk(work)
    try:
        report, took = measured(svbuild, source, "-o", output, "--memory", memory, "--json", *options)
    finally:
        space = disk.stop()
    output.unlink()
    return json.loads(report) | took | {"space": space}


def row(source, memory, said):
    points = said["points"]
    cells = said["census"].get("tetrahedra")
    rate = f"{cells / said['wall'] / 1e6:.2f} M cells/s" if cells else f"{points / said['wall'] / 1e6:.2f} M points/s"
    cells_text = f", {cells} tetrahedra" if cells else ""
    return (
        f"| `{source}` | {memory} | {points}{cells_text} | {len(said['resolutions'])} | {said['wall']:.1f} | {rate} "
        f"| {1e6 * said['cpu'] / points:.2f} | {said['peak'] / 2**20:.0f} | {said['space'] / points:.0f} "
        f"| {said['file_bytes'] / points:.1f} |"
    )


# Two versions are compared by these: a title, the number in a result of build(), its decimals.
QUANTITIES = (
    ("processor seconds", lambda said: said["cpu"], 2),
    ("seconds", lambda said: said["wall"], 2),
    ("idle, %", lambda said: 100 - 100 * said["cpu"] / (len(os.sched_getaffinity(0)) * said["wall"]), 1),
    ("peak MiB", lambda said: said["peak"] / 2**20, 0),
    ("bytes of the file", lambda said: said["file_bytes"], 0),
)


def rows_of_two(label, old, new):
    """Returns the lines of an input that two versions built several times: medians, with the least and the most."""
    for title, number_of, decimals in QUANTITIES:
        cells, medians = [], []
        for runs in (old, new):
            numbers = [number_of(said) for said in runs]
            medians.append(statistics.median(numbers))
            middle, least, most = (f"{number:.{decimals}f}" for number in (medians[-1], min(numbers), max(numbers)))
            cells.append(f"{middle} ({least}-{most})")
        ratio = f"{medians[1] / medians[0]:.3f}" if medians[0] else ""
        yield f"| {' | '.join([f'`{label}`', title, *cells, ratio])} |"


def add_options(parser):
    add_programs(parser)
    parser.add_argument("--against", type=Path, help="folder of older programs, which take turns with --programs")
    parser.add_argument("--repeat", type=count, default=5, help="with --against: builds of each input by each version")
    parser.add_argument("--work", type=Path, help="folder on the disk to measure (default: the one of temporary files)")
    for name, (what, usual, compared) in KINDS.items():
        usual = f"(default: {usual or 'none'}; with --against {compared or 'none'}, if no input is given)"
        parser.add_argument(f"--{name}", help=f"{what}, comma-separated {usual}")
    parser.add_argument("--meshes", nargs="+", default=[], metavar="FILE", help="files of meshes, built with cells")
    parser.add_argument("--memory", default="1G")
    what = "page that gets the section (default: docs/scale.md; with --against none)"
    parser.add_argument("-o", "--out", type=Path, help=what)


def sizes_of(options):
    """Returns the sizes of each kind. With --against, those that are given are all."""
    given = {name: getattr(options, name) for name in KINDS}
    if options.against and (options.meshes or any(given.values())):
        return {name: text or "" for name, text in given.items()}
    return {name: KINDS[name][2 if options.against else 1] if text is None else text for name, text in given.items()}


def inputs_of(sizes, meshes):
    """Returns pairs: an input, and options of svbuild."""
    listed = {name: [size for size in text.split(",") if size] for name, text in sizes.items()}
    vortex = {
        name: [f"gen:points:count={size},distribution=vortex,type=float32" for size in listed[name]]
        for name in ("counts", "delaunay", "none")
    }
    files = [size + IN_A_FILE for size in listed["npy"]]
    generated = [f"gen:mesh:cells={size}" for size in listed["cells"]]
    hard = [f"gen:points:count={size},distribution={d}" for size in listed["hard"] for d in POINTS if d != "vortex"]
    return [
        *((source, ["--connectivity", "boxes"]) for source in vortex["counts"] + files),
        *((source, more) for source in generated for more in ([], ["--drop-cells"])),
        *((source, ["--connectivity", "boxes"]) for source in hard),
        *(
            (source, ["--connectivity", "delaunay", *more])
            for source in vortex["delaunay"]
            for more in ([], ["--drop-cells"])
        ),
        *((source, ["--connectivity", "none"]) for source in vortex["none"]),
        *((mesh, []) for mesh in meshes),
    ]


def folders_of(options):
    return [options.programs, *([options.against] if options.against else [])]


def rows_of(options, inputs, work):
    """Builds all inputs. Yields the lines of the table."""
    builders = [folder / "svbuild" for folder in folders_of(options)]
    for source, chosen in inputs:
        label = " ".join([Path(source).name, *(option for option in chosen if option != "--connectivity")])
        with make_input(source, options.programs / "svgen", work) as made:
            turns = [
                [build(builder, made, options.memory, chosen, work) for builder in builders]
                for _ in range(options.repeat if options.against else 1)
            ]
        new, *old = zip(*turns, strict=True)
        yield from rows_of_two(label, old[0], new) if old else [row(label, options.memory, new[0])]


def text_of(options, sizes):
    """Returns the paragraph above the table."""
    version, *old = (output_of(folder / "svbuild", "--version").strip() for folder in folders_of(options))
    command = ["scale", *(["--against OLD/bin --repeat", str(options.repeat)] if old else [])]
    command += [f"--{name} {text}" for name, text in sizes.items() if text] + ["--memory", options.memory]
    command += ["--meshes", *(Path(mesh).name for mesh in options.meshes)] if options.meshes else []
    turns = "The old and the new program took turns: medians (least-most)." if old else "Each build ran once, alone."
    return f"""Made by `bench/svbench {" ".join(command)}`: {" after ".join([version, *old])}, {os.cpu_count()} cores of
        {processor()}. {turns} Scattered points have one value, positions and value in single precision, and the
        `--connectivity` in the table. The hard distributions are in double precision. Inputs are made while they are
        read, except for files."""


def run(options):
    sizes = sizes_of(options)
    titles = ("input", "quantity", "old", "new", "new / old") if options.against else TITLES
    head = [*wrapped(text_of(options, sizes)), "", *table_head(*titles)]
    if options.against:
        print("\n".join(head), flush=True)
    rows = []
    with tempfile.TemporaryDirectory(prefix="svbench-", dir=options.work) as work:
        for line in rows_of(options, inputs_of(sizes, options.meshes), work):
            rows.append(line)
            print(line, flush=True)
    page = options.out or (None if options.against else ROOT / "docs/scale.md")
    if page:
        write_section(page, "Old and new builds" if options.against else "Builds", head + rows)
