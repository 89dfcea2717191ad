"""Measures how svview keeps up with a hand that turns the data; prints a table for docs/scale.md.

Needs Python's standard library only.
"""

import json
import statistics
import tempfile
from pathlib import Path

from .common import add_programs, output_of, table_head, words


def frame(*events, seconds=0.05):
    """Returns a frame of a recording."""
    return {"seconds": seconds, "events": list(events)}


def write_recording(path, width, height, frames):
    """Writes the window as it opens, and then these frames."""
    lines = [frame(["size", width, height, width, height, 1]), *frames]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def recording(path, frames, width, height):
    """Writes a recording: without the panel a drag to and fro, frame by frame."""
    lines = [frame(["key", 258, True], ["key", 258, False])]
    lines += [frame(["pointer", 0.3 * width, 0.5 * height]), frame(["button", 0, True])]
    for i in range(frames):
        x = 0.3 * width + 0.4 * width * (1 - abs(1 - 2 * i / frames))
        lines.append(frame(["pointer", x, 0.5 * height + 0.1 * height * (i / frames)]))
    lines.append(frame(["button", 0, False]))
    write_recording(path, width, height, lines)


def sharpening(path, width, height):
    """Writes a recording of short drags and rests. In a rest the hand is still until the picture begins to sharpen, and
    then moves the pointer over the panel. Returns the numbers of the frames with such a pointer."""
    drags, moves, rests, frames_a_rest = 8, 4, 12, 5
    lines, waiting = [], []
    for drag in range(drags):
        at = (0.6 + 0.02 * drag) * width
        lines += [frame(["pointer", at, 0.5 * height]), frame(["button", 0, True])]
        lines += [frame(["pointer", at + 8 * i, 0.5 * height + 3 * i]) for i in range(moves)]
        lines.append(frame(["button", 0, False]))
        for rest in range(rests):
            lines.append(frame(seconds=0.2))
            for i in range(frames_a_rest):
                waiting.append(1 + len(lines))  # behind the window's
                lines.append(frame(["pointer", 40 + 10 * rest + i, 0.3 * height + i], seconds=1 / 60))
    write_recording(path, width, height, lines)
    return waiting


def look(options, file, device, replayed):
    """Draws a recording once. Returns svview's statistics."""
    work = replayed.parent
    command = [options.programs / "svview", file, "--replay", replayed, "--device", device]
    command += ["--stats", work / "stats.json", "--memory", options.memory]
    output_of(*command)
    return json.loads((work / "stats.json").read_text())


def line(file, device, runs, left_out, waits):
    """Returns a row of the table. Leaves out the first frames, in which svview finds how coarse the picture must be.
    `waits`: seconds of the interface's frames while the picture sharpens."""
    frames = [t for run in runs for t in run["frame_seconds"][left_out:-1]]
    splats = [n for run in runs for n in run["frame_splats"][left_out:-1]]
    median = statistics.median(frames)
    slow, slowest = statistics.quantiles(frames, n=20)[-1], statistics.quantiles(frames, n=100)[-1]
    first, rest = (statistics.median(run[name] for run in runs) for name in ("first_picture_seconds", "rest_seconds"))
    return (
        f"| {file.stem} | {device} | {1000 * first:.0f} | {1000 * median:.0f} | {1000 * slow:.0f} "
        f"| {1000 * slowest:.0f} | {1 / median:.0f} | {statistics.median(splats):.0f} | {1000 * rest:.0f} "
        f"| {1000 * statistics.quantiles(waits, n=100)[-1]:.0f} |"
    )


def add_options(parser):
    parser.add_argument("files", nargs="+", type=Path, help=".svol files")
    add_programs(parser)
    parser.add_argument(
        "--devices",
        type=words,
        default=["cpu", "gl"],
        help="--device of svview, comma-separated (default: cpu,gl); they take turns",
    )
    parser.add_argument("--memory", default="64M")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--size", type=lambda text: [int(side) for side in text.split("x")], default=[800, 600])


def run(options):
    titles = ["file", "device", "first picture ms", "frame ms, median", "95 %", "99 %", "frames/s", "splats"]
    titles += ["ms to full detail at rest", "interface ms while it sharpens, 99 %"]
    print("\n".join(table_head(*titles)))
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        drag, pauses = Path(work) / "drag.jsonl", Path(work) / "pauses.jsonl"
        recording(drag, options.frames, *options.size)
        waiting = sharpening(pauses, *options.size)
        for file in options.files:
            runs = {device: [] for device in options.devices}
            waits = {device: [] for device in options.devices}
            for _ in range(options.turns):
                for device in options.devices:
                    runs[device].append(look(options, file, device, drag))
                    frames = look(options, file, device, pauses)["frame_seconds"]
                    waits[device] += [frames[number] for number in waiting]
            for device in options.devices:
                print(line(file, device, runs[device], 3 + options.frames // 10, waits[device]), flush=True)
