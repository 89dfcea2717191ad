"""Measures whether changes of resolution show; prints a table.

Compares successive frames along a slow camera path, with fading and without. The measure is the difference between
them, relative to the same path at a fixed resolution. Needs Python's standard library only.
"""

import json
import statistics
import tempfile
from pathlib import Path

from .common import add_programs, output_of, table_head


def render(options, file, *more):
    """Draws the path. Returns the largest and the mean difference of successive frames (RMSE of linear RGB), the mean
    number of splats, and the number of frames in which something fades."""
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        stats = Path(work) / "stats.json"
        command = [options.programs / "svrender", file, "--scene", options.scenes / f"{file.stem}.json"]
        command += ["--size", options.size, "--path", options.path, "-o", Path(work) / "last.png"]
        command += ["--stats", stats, *more]
        output_of(*command)
        frames = json.loads(stats.read_text())["path_frames"]
    steps = [frame["step"] for frame in frames[1:]]
    splats = statistics.mean(frame["splats"] for frame in frames)
    return max(steps), statistics.mean(steps), splats, sum(frame["fading"] > 0 for frame in frames)


def add_options(parser):
    parser.add_argument("files", nargs="+", type=Path, help=".svol files; each needs a scene of the same name")
    parser.add_argument("--scenes", type=Path, required=True, help="folder of scene files")
    add_programs(parser)
    parser.add_argument("--path", default="120,6,0.85", help="as svrender takes it")
    parser.add_argument("--tolerances", nargs="+", default=["4", "8"])
    parser.add_argument("--fades", nargs="+", default=["1", "8", "16"], help="frames of a change of resolution")
    parser.add_argument("--size", default="256x256")


def run(options):
    titles = ["scene", "tolerance %", "frames a change takes", "splats", "frames with changes", "largest difference"]
    titles += ["of the fixed resolution's", "mean difference", "of the fixed resolution's"]
    print("\n".join(table_head(*titles)))
    for file in options.files:
        fixed_max, fixed_mean, splats, _ = render(options, file, "--resolution", "99")
        fixed = f"| {file.stem} | all points | | {splats:.0f} | | {fixed_max:.5f} | 1 | {fixed_mean:.5f} | 1 |"
        print(fixed, flush=True)
        for tolerance in options.tolerances:
            for fade in options.fades:
                largest, mean, splats, fading = render(options, file, "--tolerance", tolerance, "--fade", fade)
                print(
                    f"| | {tolerance} | {fade} | {splats:.0f} | {fading} | {largest:.5f} "
                    f"| {largest / fixed_max:.2f} | {mean:.5f} | {mean / fixed_mean:.2f} |",
                    flush=True,
                )
