"""Compares what svbuild --estimate says with builds; writes the section "Estimates beside builds" of docs/scale.md.

  bench/svbench estimates                         inputs of its own
  bench/svbench estimates --meshes a.vtu b.vtu    files besides

Each input is built once. Its own inputs take up to 240 MB in the folder for temporary files. Needs numpy.
"""

import json
import multiprocessing
import os
import tempfile
from pathlib import Path

import numpy as np

from .common import ROOT, Failure, add_programs, output_of, processor, table_head, wrapped, write_section
from .hard_meshes import in_tetrahedra, lattice, smooth
from .scale import build

TITLES = (
    *("input", "points", "file, MB", "estimate", "disk, MB", "estimate", "memory, MiB", "estimate"),
    *("processor time, s", "estimate"),
)


def values_of(points, attributes):
    return {f"v{k}": smooth(points + k) for k in range(attributes)}


def bent(mesh, attributes):
    """A lattice with bent edges, and values."""
    points = mesh.points + 0.02 * np.sin(5 * np.roll(mesh.points, 1, axis=1))
    mesh = type(mesh)(points.astype("f4").astype("f8"), mesh.cells, mesh.kind)
    mesh.values = values_of(mesh.points, attributes)
    return mesh


class Scattered:
    """Points on a ball's rays, denser in the middle: a .npy file in single precision."""

    suffix = ".npy"

    def __init__(self, count, attributes):
        self.count, self.attributes = count, attributes

    def write(self, path):
        random = np.random.default_rng(1)
        rays = random.normal(size=(self.count, 3))
        points = rays / np.linalg.norm(rays, axis=1)[:, None] * random.random((self.count, 1))
        np.save(path, np.column_stack([points, *values_of(points, self.attributes).values()]).astype("f4"))


# Inputs: what they are, how they are made, svbuild's memory, and its options.
INPUTS = (
    ("scattered, 1 attribute", lambda: Scattered(10_000_000, 1), "1G", ("--connectivity", "boxes")),
    ("scattered, 9 attributes", lambda: Scattered(5_000_000, 9), "128M", ("--connectivity", "boxes")),
    ("scattered, 9 attributes", lambda: Scattered(1_000_000, 9), "1G", ("--connectivity", "none")),
    ("scattered, 1 attribute", lambda: Scattered(500_000, 1), "1G", ("--connectivity", "delaunay")),
    ("scattered, 1 attribute", lambda: Scattered(1_500_000, 1), "1G", ("--connectivity", "delaunay")),
    ("cubes, 9 attributes", lambda: bent(lattice(80), 9), "1G", ("--drop-cells",)),
    ("cubes, 3 attributes", lambda: bent(lattice(80), 3), "1G", ("--exact",)),
    ("tetrahedra, 1 attribute", lambda: bent(in_tetrahedra(lattice(70)), 1), "1G", ()),
    ("tetrahedra, 3 attributes", lambda: bent(in_tetrahedra(lattice(70)), 3), "64M", ("--drop-cells",)),
)


def make_in_a_process(make, work):
    """Returns the path of an input. The memory of this process would count as that of the programs it starts."""
    path = Path(work) / "input"
    process = multiprocessing.get_context("fork").Process(target=lambda: write(make(), path))
    process.start()
    process.join()
    if process.exitcode != 0:
        raise Failure("an input cannot be made")
    return next(Path(work).glob("input.*"))


def write(made, path):
    made.write(path.with_suffix(made.suffix))


def processor_seconds(estimate):
    """The estimate is of the time on some threads: a tenth of the work is done by one of them."""
    return [seconds / (0.1 + 0.9 / estimate["threads"]) for seconds in estimate["seconds"]]


def rounded(number):
    return f"{number:.0f}" if number >= 100 else f"{number:.3g}"


def row(what, source, memory, options, svbuild, work):
    estimate = json.loads(output_of(svbuild, "--estimate", source, "--json", "--memory", memory, *options))
    said = build(svbuild, source, memory, options, work)
    columns = (
        (said["file_bytes"], estimate["file_bytes"], 1e6),
        (said["space"], estimate["disk_bytes"], 1e6),
        (said["peak"], estimate["memory_bytes"], 2**20),
        (said["cpu"], processor_seconds(estimate), 1),
    )
    cells = [
        f"{rounded(is_so / unit)} | {rounded(low / unit)} to {rounded(high / unit)}" for is_so, (low, high), unit in columns
    ]
    label = f"{what} `{' '.join(['--memory', memory, *options])}`"
    return f"| {label} | {said['points']} | {' | '.join(cells)} |"


def add_options(parser):
    add_programs(parser)
    parser.add_argument("--work", type=Path, help="folder on the disk to measure (default: the one of temporary files)")
    parser.add_argument("--meshes", nargs="+", type=Path, default=[], metavar="FILE", help="files of meshes")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/scale.md", help="page that gets the section")


def run(options):
    svbuild = options.programs / "svbuild"
    command = "bench/svbench estimates"
    if options.meshes:
        command += f" --meshes {' '.join(mesh.name for mesh in options.meshes)}"
    text = f"""Made by `{command}`: {output_of(svbuild, "--version").strip()}, {os.cpu_count()} cores of {processor()}. Each
        build ran once, alone. The time is that of all processors. Scattered points are in `.npy` files, cubes and
        tetrahedra lattices with bent edges in a `.vtu`."""
    lines = [*wrapped(text), "", *table_head(*TITLES)]
    print("\n".join(lines), flush=True)
    with tempfile.TemporaryDirectory(prefix="svbench-", dir=options.work) as work:

        def add(*arguments):
            lines.append(row(*arguments, svbuild, work))
            print(lines[-1], flush=True)

        for what, make, memory, more in INPUTS:
            path = make_in_a_process(make, work)
            add(what, path, memory, more)
            path.unlink()
        for mesh in options.meshes:
            add(mesh.name, mesh, "1G", ())
    write_section(options.out, "Estimates beside builds", lines)
