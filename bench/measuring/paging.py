"""Measures the cost of a view for files of different sizes; writes the section Views of docs/scale.md.

It draws one scene of every file, so all files must show the same data. svbuild makes such files from
gen:points:count=N,distribution=vortex,type=float32 (--connectivity boxes). Needs Python's standard library only.
"""

import json
import os
import statistics
import tempfile
from pathlib import Path

from .common import ROOT, add_programs, forget, measured, output_of, processor, table_head, wrapped, write_section

TITLES = (
    *("points", "file GB", "first picture ms", "KiB read for it", "frames until complete"),
    *("longest wait for a frame's splats ms", "splats", "KiB read", "splats at once", "KiB read at once", "cut ms"),
    *("frame ms", "resident MiB", "process MiB"),
)


def render(programs, file, options, work, *more):
    """Draws one picture. Returns svrender's statistics, with the peak memory of its process in bytes."""
    command = [programs / "svrender", file, "--scene", options.scene, "--tolerance", options.tolerance]
    command += ["--memory", options.memory, "--device", options.device]
    command += ["-o", Path(work) / "picture.png"]
    command += ["--stats", Path(work) / "stats.json", *more]
    _, took = measured(*command)
    return json.loads((Path(work) / "stats.json").read_text()) | took


def row(programs, file, options):
    info = json.loads(output_of(programs / "svinfo", "--json", file))
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        firsts = []
        for _ in range(options.turns):
            forget(file)
            firsts.append(render(programs, file, options, work, "--progress-frames", work))
        forget(file)
        whole = render(programs, file, options, work, "--repeat", "5")
    first = [stats["progress_frames"][0] for stats in firsts]
    last = firsts[-1]
    longest = max(frame["advance_seconds"] for stats in firsts for frame in stats["progress_frames"][1:])
    milliseconds = [1000 * frame["seconds"] for frame in first]
    return (
        f"| {info['points']:.3g} | {whole['file_bytes'] / 1e9:.2f} "
        f"| {statistics.median(milliseconds):.0f} ({min(milliseconds):.0f} to {max(milliseconds):.0f}) "
        f"| {first[0]['bytes_read'] / 1024:.0f} | {len(last['progress_frames'])} | {1000 * longest:.0f} "
        f"| {last['splats']} | {last['bytes_read'] / 1024:.0f} | {whole['splats']} | {whole['bytes_read'] / 1024:.0f} "
        f"| {1000 * whole['seconds']['cut']:.1f} | {1000 * whole['seconds']['frame']:.0f} "
        f"| {whole['bytes_resident_peak'] / 2**20:.1f} | {whole['peak'] / 2**20:.0f} |"
    )


def add_options(parser):
    parser.add_argument("files", nargs="+", type=Path, help=".svol files of the same data, smallest first")
    parser.add_argument("--scene", type=Path, required=True, help="scene file, such as svinfo --scene writes")
    add_programs(parser)
    parser.add_argument("--tolerance", default="3")
    parser.add_argument("--memory", default="64M")
    parser.add_argument("--device", choices=["cpu", "gl"], default="cpu", help="--device of svrender")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/scale.md")


def run(options):
    lines = [
        *wrapped(
            f"""Made by `bench/svbench paging` at a tolerance of {options.tolerance} % in {options.memory}:
            {os.cpu_count()} cores of {processor()}, `--device {options.device}`. The same
            scene shows the same vortex in more and more points. The file is dropped from the system's cache before each
            run. The time of the first picture counts from the beginning of the program's work: the median of
            {options.turns} runs, and their range. `--progress-frames` draws the data that is there and does not wait.
            Without it (at once), svrender first reads all that the view needs. Resident is the peak of memory held of
            the file."""
        ),
        "",
        *table_head(*TITLES),
    ]
    for file in options.files:
        lines.append(row(options.programs, file, options))
        print(lines[-1], flush=True)
    write_section(options.out, "Views", lines)
