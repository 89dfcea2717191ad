"""Judges what svview shows while a hand moves; prints tables, in which ! marks a missed bar.

The program `moving` uses the viewer by a real clock: it turns the data right after opening, and from rest; turns back
and upwards; zooms to a detail and back; presses 1, 2, 3, R; slides the opacity; plays steps. Each script ends at rest.
Pictures that were shown are compared with exact ones of the same scene, in every third pixel. The window is drawn for
a framebuffer: it is not swapped. Needs Python's standard library only.

  svbench moving --shared ../shared -o now.json              measures
  svbench moving --shared ../shared --against OTHER/bin      measures two builds in turn
  svbench moving --read before.json now.json                 tells of what was measured before
"""

import array
import json
import math
import os
import statistics
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from .common import ROOT, Failure, add_programs, output_of, processor, table_head, warn, words
from .measure import mesh_of



@dataclass(frozen=True)
class Bars:
    """How good the numbers of a view shall be."""

    error: float = 0.002  # RMSE of linear RGB, in the median
    error_95: float = 0.006  # of all pictures but 5 %
    srgb_error: float = 0.02  # of any picture
    light: float = 0.01  # of a picture over that of the exact one, from 1
    rate: float = 15  # pictures a second, in the median
    rate_95: float = 10  # of all pictures but 5 %
    late: float = 0.05  # share of pictures that take longer from input to window than two pictures and a window
    changes: float = 2  # of the rung in a drag, after its first pictures
    window: float = 0.008  # seconds of a frame besides the picture, in the median
    rest: float = 0.1  # seconds from the last event to an exact picture with samples apart


LARGE = Bars(error=0.005, error_95=math.inf, srgb_error=math.inf, light=math.inf, rate=10, rate_95=0, rest=math.inf)
NO_CELLS = Bars(math.inf, math.inf, math.inf, math.inf, 0, 0, rest=math.inf)  # to be compared with another run
SETTLING_PICTURES = 5  # of a drag
SAME_SPLATS = 1.5  # pictures of splats count as one rung up to this ratio of their numbers
TRUE_ERROR = 1e-4  # of a picture that is exact in every pixel
STEPS = "steps"  # a view of a generated time series
SERIES = 16  # steps of it
SIDE = 51  # points along each edge of its box


def percentile(numbers, percent):
    """Returns a number that so many percent do not exceed; 0 if there are none."""
    ordered = sorted(numbers)
    return ordered[max(0, math.ceil(len(ordered) * percent / 100) - 1)] if ordered else 0


# Files and views to measure.


def write_step(path, step):
    """Writes a step of a series: a wave that runs through a box, in VTK's legacy format."""
    line = [i / (SIDE - 1) for i in range(SIDE)]
    waves = [[math.sin(6 * x + 9 * y * y - 0.8 * step) for x in line] for y in line]
    values = array.array("f")
    for z in line:
        for y in range(SIDE):
            values.extend(math.exp(-8 * (z - 0.5) ** 2) * wave + z for wave in waves[y])
    if sys.byteorder == "little":
        values.byteswap()
    head = f"# vtk DataFile Version 3.0\nwave\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {SIDE} {SIDE} {SIDE}\n"
    head += f"ORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA {SIDE**3}\nSCALARS wave float 1\nLOOKUP_TABLE default\n"
    path.write_bytes(head.encode() + values.tobytes() + b"\n")


def build_steps(programs, output):
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        paths = [Path(work) / f"wave_{step}.vtk" for step in range(SERIES)]
        for step, path in enumerate(paths):
            write_step(path, step)
        output_of(programs / "svbuild", "--series", *paths, "-o", output)


class View:
    """What a viewer opens. `scene` None: one that fits the data."""

    def __init__(self, name, file, scene=None):
        self.name, self.file, self.scene = name, file, scene


def view_of(options, name):
    """Returns a view, whose file is built unless an earlier run has kept it."""
    is_generated = name.startswith("gen:")
    mesh = name.replace(":", "-").replace(",", "-") if is_generated else mesh_of(name)
    file = options.keep / f"{mesh}.svol"
    if not file.exists():
        if name == STEPS:
            build_steps(options.programs, file)
        else:
            source = name if is_generated else options.shared / "data" / f"{mesh}.vtu"
            output_of(options.programs / "svbuild", source, "-o", file)
    return View(name, file, None if is_generated or name == STEPS else options.shared / "scenes" / f"{name}.json")


def measure(options, programs, view, result):
    """Runs the scripts on a view, and adds what they tell to `result`."""
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        output = Path(work) / "moving.json"
        command = [programs / "moving", view.file, "-o", output, "--compared", options.compared, "--size", options.size]
        command += ["--memory", options.memory]
        if view.scene:
            command += ["--scene", view.scene]
        if view.name == STEPS:
            command += ["--scripts", "play"]
        elif options.scripts:
            command += ["--scripts", ",".join(options.scripts)]
        if options.no_panel:
            command += ["--no-panel"]
        if options.dump:
            folder = options.dump / view.file.with_name(view.name.replace(":", "-")).name
            folder.mkdir(parents=True, exist_ok=True)
            command += ["--dump", folder]
        output_of(*command)
        result.setdefault(view.name, []).extend(json.loads(output.read_text())["scripts"])


# What it tells.


class Told:
    """The numbers of some scripts. `shown`: pictures that moved; `compared`: those of them with an error."""

    def __init__(self, scripts):
        self.scripts = scripts
        self.shown = [picture for script in scripts for picture in moving(script)]
        self.compared = [picture for picture in self.shown if "rmse" in picture]
        self.errors = [picture["rmse"] for picture in self.compared]
        self.lights = [picture["light"] for picture in self.compared if "light" in picture]
        self.srgb = max((picture["srgb_rmse"] for picture in self.compared), default=0)
        self.intervals = [interval for script in scripts if script["is_steady"] for interval in intervals_of(script)]
        self.latencies, self.late = latencies_of(scripts)
        drags = [script for script in scripts if script["name"] in ("first", "turn", "back")]
        self.changes = max((changes_of(script) for script in drags), default=0)
        self.windows = [frame[2] for script in scripts for frame in showing_frames(script)]
        rests = [rest_of(script) for script in scripts if script["name"] != "play"]
        self.apart = max((apart for apart, _ in rests), default=0)
        self.whole = max((whole for _, whole in rests), default=0)
        self.told = [p["told_error"] / p["rmse"] for p in self.compared if "told_error" in p and p["rmse"] > TRUE_ERROR]
        self.worse = sum(is_worse_at_rest(script) for script in scripts)

    def cells(self, bars):
        """Returns the cells of a row, and how many bars are missed."""
        low, high = min(self.lights, default=1), max(self.lights, default=1)
        error, error_95 = (percentile(self.errors, p) for p in (50, 95))
        rate, rate_95 = (1 / percentile(self.intervals, p) if self.intervals else None for p in (50, 95))
        late = self.late / max(len(self.latencies), 1)
        window = statistics.median(self.windows) if self.windows else 0
        judged = [
            (f"{error:.4f}", error <= bars.error),
            (f"{error_95:.4f}", error_95 <= bars.error_95),
            (f"{max(self.errors, default=0):.4f}", True),
            (f"{self.srgb:.3f}", self.srgb <= bars.srgb_error),
            (f"{low:.3f} to {high:.3f}", low >= 1 - bars.light and high <= 1 + bars.light),
            (f"{rate:.0f}" if rate else "", not rate or rate >= bars.rate),
            (f"{rate_95:.0f}" if rate_95 else "", not rate_95 or rate_95 >= bars.rate_95),
            (" ".join(f"{1000 * percentile(self.latencies, p):.0f}" for p in (50, 95, 100)), True),
            (f"{100 * late:.0f}", late <= bars.late),
            (f"{self.changes}", self.changes <= bars.changes),
            (f"{1000 * window:.1f}", window <= bars.window),
            (seconds_text(self.apart), self.apart <= bars.rest),
            (seconds_text(self.whole), True),
            (f"{self.worse}", self.worse == 0),
            (f"{percentile(self.told, 5):.1f} to {percentile(self.told, 95):.1f}" if self.told else "", True),
        ]
        misses = sum(not met for _, met in judged)
        return [str(len(self.shown)), *(text if met else f"{text}!" for text, met in judged), str(misses)], misses

    def drawn(self):
        """Returns what was drawn, as text: the kinds of pictures, and how many of each. Also the steps that played."""
        kinds = Counter(map(name_of_rung, self.shown))
        texts = [f"{kind}: {count}" for kind, count in kinds.most_common(6)]
        for script in self.scripts:
            if script["name"] == "play":
                texts.append(f"{len({p['step'] for p in moving(script)})} steps in {script['motions'][0][1]:g} s")
        return "; ".join(texts)


TITLES = ["pictures", "RMSE", "95 %", "most", "sRGB, most", "light", "pictures/s", "95 %"]
TITLES += ["latency ms: median, 95 %, most", "late %", "rungs", "window ms", "rest: apart s", "every pixel s", "worse"]
TITLES += ["error told / true, 5 to 95 %"]


def seconds_text(seconds):
    return "never" if seconds == math.inf else f"{seconds:.2f}"


def moving(script):
    """Returns the pictures that were shown while something moved. While steps play, all are."""
    if script["name"] == "play":
        return [picture for picture in script["pictures"] if picture["shown"] <= script["motions"][0][1]]
    return [picture for picture in script["pictures"] if picture["moves"]]


def bars_of(view, scripts):
    if not all(script["has_cells"] for script in scripts):
        return NO_CELLS
    return LARGE if view.startswith("gen:") else Bars()


def intervals_of(script):
    """Returns the seconds from one shown picture to the next, while the hand moves. The first one counts from the
    hand's start. Nothing new for longer than that at the end counts, too."""
    intervals = []
    for begin, end in script["motions"]:
        times = [begin, *(p["shown"] for p in moving(script) if begin < p["shown"] <= end)]
        found = [after - before for before, after in zip(times, times[1:])]
        if not found or end - times[-1] > max(found):
            found.append(end - times[-1])
        intervals += found
    return intervals


def latencies_of(scripts):
    """Returns the seconds from an input to the first picture of its camera, and how many of them are late."""
    latencies, late = [], 0
    for script in scripts:
        if script["name"] == "play":
            continue
        window = percentile([frame[2] for frame in showing_frames(script)], 95)
        seen, before = set(), 0
        for picture in moving(script):
            if (asked := picture.get("asked")) is not None and asked not in seen:
                seen.add(asked)
                latencies.append(picture["shown"] - asked)
                late += latencies[-1] > picture["seconds"] + max(before, picture["seconds"]) + window
            before = picture["seconds"]
    return latencies, late


def changes_of(script):
    """Counts changes of what is drawn, after the first pictures."""
    changes, before = 0, None
    for picture in moving(script)[SETTLING_PICTURES - 1 :]:
        splats, spacing = picture["splats"], picture["spacing"]
        if before and before[1] == spacing and (before[0] == 0) == (splats == 0):
            low, high = sorted((max(splats, 1), max(before[0], 1)))
            if high <= SAME_SPLATS * low:
                continue
        changes += before is not None
        before = (splats, spacing)
    return changes


def showing_frames(script):
    """Returns the frames with a new picture, while the hand moves or has just moved."""
    frames, last = [], None
    for frame in script["frames"]:
        begin, number = frame[0], frame[3]
        if number != last and any(first <= begin <= end + 0.15 for first, end in script["motions"]):
            frames.append(frame)
        last = number
    return frames


def rest_of(script):
    """Returns the seconds from the hand's last event to an exact picture, with samples apart and in every pixel."""
    end = script["motions"][-1][1]
    exact = [p for p in script["pictures"] if p.get("is_last") and p["splats"] == 0]
    whole = [p for p in exact if p["spacing"] == 1]
    return tuple(max(0, min((p["shown"] - end for p in some), default=math.inf)) for some in (exact, whole))


def is_worse_at_rest(script):
    """Whether a picture at rest is worse than the one before it, though both show the same scene."""
    last = None
    for picture in script["pictures"]:
        if "rmse" not in picture:
            continue
        is_same = last and all(last.get(name) == picture.get(name) for name in ("asked", "step"))
        if is_same and not picture["moves"] and picture["rmse"] > 1.1 * last["rmse"] + TRUE_ERROR:
            return True
        last = picture
    return False


def name_of_rung(picture):
    if picture["splats"] == 0:
        return "exact" if picture["spacing"] == 1 else f"exact, {picture['spacing']} apart"
    return f"{2 ** round(math.log2(picture['splats']))} splats"


def check_exact(view, scripts):
    """Warns if pictures are called exact that are not."""
    errors = [
        picture["rmse"]
        for script in scripts
        for picture in script["pictures"]
        if picture["splats"] == 0 and picture["spacing"] == 1 and "rmse" in picture
    ]
    if max(errors, default=0) > TRUE_ERROR:
        warn(f"{view}: a picture that is exact in every pixel has an error of {max(errors):.5f}")


def tables(runs, with_scripts):
    """Returns lines: a row for each view and run, and on request one for each script."""
    labels = list(runs)
    first = ["view"] + (["run"] if len(labels) > 1 else [])
    lines, missed = table_head(*first, *TITLES, "bars missed", "drawn while it moves"), 0
    for view in dict.fromkeys(view for run in runs.values() for view in run):
        for label in labels:
            scripts = runs[label].get(view, [])
            check_exact(view, scripts)
            groups = [(view, scripts)]
            if with_scripts:
                names = dict.fromkeys(script["name"] for script in scripts)
                groups += [(f"{view}: {name}", [s for s in scripts if s["name"] == name]) for name in names]
            for name, group in groups:
                if not group:
                    continue
                told = Told(group)
                cells, misses = told.cells(bars_of(view, group))
                missed += misses if name == view else 0
                row = [name, *([label] if len(labels) > 1 else []), *cells, told.drawn()]
                lines.append(f"| {' | '.join(row)} |")
    return [*lines, "", f"{missed} bars are missed (!)."]


def explain():
    bars = Bars()
    return (
        f"Bars: RMSE {bars.error}, at 95 % {bars.error_95}; sRGB {bars.srgb_error}; light within {100 * bars.light:g} "
        f"%; {bars.rate} pictures/s, at 95 % {bars.rate_95}; {100 * bars.late:g} % late: more than two pictures' time "
        f"and a window's from input to window; {bars.changes} changes of rung in a drag; window {1000 * bars.window:g} "
        f"ms; {bars.rest} s to an exact picture at rest; no picture at rest worse than the one before. Rungs and rest: "
        f"the most of any script. A generated mesh: RMSE {LARGE.error}, {LARGE.rate} pictures/s."
    )


# The command.


def add_options(parser):
    add_programs(parser)
    parser.add_argument("--shared", type=Path, help="folder with data/MESH.vtu and scenes/VIEW.json")
    parser.add_argument("--against", type=Path, help="folder of other programs, which take turns with --programs")
    parser.add_argument("--views", type=words, help="of: scenes, steps, gen:... (default: all scenes, steps)")
    parser.add_argument("--large", action="store_true", help="besides: gen:mesh:cells=2e7")
    parser.add_argument("--points", metavar="COUNT", help="besides: gen:points:count=COUNT")
    parser.add_argument("--scripts", type=words, help="of: first,turn,back,in,out,keys,opacity,play (default: all)")
    parser.add_argument("--turns", type=int, default=1)
    parser.add_argument("--compared", type=int, default=16, help="moving pictures of a script to compare (default: 16)")
    parser.add_argument("--size", default="1280x800", help="of the window (default: 1280x800)")
    parser.add_argument("--no-panel", action="store_true", help="the picture fills the window")
    parser.add_argument("--memory", default="512M", help="as svview's (default: 512M)")
    parser.add_argument("--keep", type=Path, default=ROOT / "build/moving", help="folder of volumes for later runs")
    parser.add_argument("--dump", type=Path, help="folder for pictures: the worst of each script beside the exact one")
    parser.add_argument("--by-script", action="store_true", help="also a row for each script")
    parser.add_argument("-o", "--out", type=Path, help="keep what was measured, for --read")
    parser.add_argument("--read", nargs="+", type=Path, metavar="JSON", help="measure nothing: read these")


def names_of_views(options):
    if not options.shared:
        raise Failure("--shared FOLDER or --read JSON: nothing to measure")
    names = options.views or [*sorted(path.stem for path in (options.shared / "scenes").glob("*.json")), STEPS]
    names += ["gen:mesh:cells=2e7"] if options.large else []
    return names + ([f"gen:points:count={options.points}"] if options.points else [])


def measured_runs(options):
    """Returns the scripts of each view, of each build."""
    options.keep.mkdir(parents=True, exist_ok=True)
    builds = {"now": options.programs} | ({"against": options.against} if options.against else {})
    runs = {label: {} for label in builds}
    for view in [view_of(options, name) for name in names_of_views(options)]:
        for _ in range(options.turns):
            for label, programs in builds.items():
                measure(options, programs, view, runs[label])
        rows = tables({label: {view.name: run[view.name]} for label, run in runs.items()}, False)[2:-2]
        print("\n".join(rows), flush=True)
        keep(options, runs)
    return runs


def keep(options, runs):
    """Writes what has been measured so far: a long run may be ended."""
    if options.out:
        machine = {"processor": processor(), "cores": os.cpu_count(), "size": options.size}
        options.out.write_text(json.dumps({"machine": machine, "runs": runs}) + "\n")


def read_runs(paths):
    runs = {}
    for path in paths:
        for label, run in json.loads(path.read_text())["runs"].items():
            runs[path.stem if label == "now" else f"{path.stem} {label}"] = run
    return runs


def run(options):
    runs = read_runs(options.read) if options.read else measured_runs(options)
    if not options.read:
        print(f"\n{os.cpu_count()} cores of {processor()}, window {options.size}")
    print("\n".join(["", explain(), "", *tables(runs, options.by_script)]))
