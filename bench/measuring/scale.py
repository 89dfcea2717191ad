"""Measures how svbuild builds larger and larger volumes; writes the section Builds of docs/scale.md.

Inputs are svgen's and are made while they are read (gen:...), so they take no disk space. The times include making
them, except for .npy files. Each build runs alone; its files are removed. Needs Python's standard library only.
"""

import json
import os
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path

from .common import ROOT, add_programs, measured, output_of, processor, table_head, wrapped, write_section

POINTS = ["uniform", "vortex", "half-tiny", "equal", "two-clusters", "line", "layer", "clusters"]
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
    if not source.endswith(".npy"):
        yield source
        return
    path = Path(work) / "points.npy"
    count = source.split()[0]
    recipe = ["--count", count, "--distribution", "vortex", "--float32"]
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


def add_options(parser):
    add_programs(parser)
    parser.add_argument("--work", type=Path, help="folder on the disk to measure (default: the one of temporary files)")
    parser.add_argument("--counts", default="1e6,1e7,1e8", help="scattered points, comma-separated")
    parser.add_argument("--npy", default="1e8", help="scattered points in a file, comma-separated")
    parser.add_argument("--cells", default="6e6,6e7", help="tetrahedra of partitioned meshes, comma-separated")
    parser.add_argument("--hard", default="1e7", help="points of the hard distributions")
    parser.add_argument("--delaunay", default="4e6", help="scattered points to join by Delaunay tetrahedra")
    parser.add_argument("--memory", default="1G")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/scale.md")


def run(options):
    scattered = [f"gen:points:count={count},distribution=vortex,type=float32" for count in options.counts.split(",")]
    meshes = [f"gen:mesh:cells={cells}" for cells in options.cells.split(",")] if options.cells else []
    hard = [f"gen:points:count={options.hard},distribution={d}" for d in POINTS if d != "vortex" and options.hard]
    counts = [count for count in options.delaunay.split(",") if count]
    joined = [f"gen:points:count={count},distribution=vortex,type=float32" for count in counts]
    files = [f"{count} points in a .npy" for count in options.npy.split(",") if count]
    runs = [(source, ["--connectivity", "boxes"]) for source in scattered + files]
    runs += [(source, options) for source in meshes for options in ([], ["--drop-cells"])]
    runs += [(source, ["--connectivity", "boxes"]) for source in hard]
    runs += [(source, ["--connectivity", "delaunay", *more]) for source in joined for more in ([], ["--drop-cells"])]
    version = output_of(options.programs / "svbuild", "--version").strip()
    lines = [
        *wrapped(
            f"""Made by `bench/svbench scale --counts {options.counts} --npy {options.npy} --cells {options.cells}
            --hard {options.hard} --memory {options.memory} --delaunay {options.delaunay}`: {version}, {os.cpu_count()}
            cores of {processor()}. Each build ran once, alone. Scattered points have one value, positions and value in
            single precision, and the `--connectivity` in the table. The hard distributions are in double precision.
            Inputs are made while they are read, except for files."""
        ),
        "",
        *table_head(*TITLES),
    ]
    with tempfile.TemporaryDirectory(prefix="svbench-", dir=options.work) as work:
        for source, chosen in runs:
            with make_input(source, options.programs / "svgen", work) as made:
                said = build(options.programs / "svbuild", made, options.memory, chosen, work)
            label = " ".join([source, *(option for option in chosen if option != "--connectivity")])
            lines.append(row(label, options.memory, said))
            print(lines[-1], flush=True)
    write_section(options.out, "Builds", lines)
