"""Runs the programs and the peers, and writes their results as CSV.

A view's settings and peers take turns, a few frames each, so that other work of the machine hits all of them alike.
A time is the median of the turns' medians, with the fastest and the slowest frame.
"""

import csv
import json
import os
import statistics
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from . import peers, pictures
from .common import output_of, processor

FRAME_FIELDS = (
    "part view mesh connectivity device kernel tolerance resolution max_splats max_error sort sampling "
    "sample_spacing points splats nodes bytes_read file_bytes first_image_s frame_s frame_min_s frame_max_s cut_s sort_s draw_s "
    "expected_error rmse psnr max light ripple outline flip"
).split()
BUILD_FIELDS = "mesh connectivity points resolutions seconds seconds_min seconds_max file_bytes input_bytes".split()
CELLS = "cells"
REFERENCE_FIELDS = "view tetrahedra segments_per_pixel seconds rmse max".split()


@dataclass(frozen=True)
class Setting:
    """Options of svrender. Draws by tolerance if `resolution` and `splats` are None."""

    kernel: str
    tolerance: float = 0
    resolution: int | None = None
    sort: str = "exact"
    sampling: str = "auto"
    splats: int | None = None
    device: str = "auto"

    def detail(self):
        if self.splats is not None:
            return {"splats": self.splats}
        if self.resolution is None:
            return {"tolerance": f"{self.tolerance:g}"}
        return {"resolution": self.resolution}

    def options(self):
        names = ("device", "kernel", "sort", "sampling")
        return {name: getattr(self, name) for name in names} | self.detail()

    def row(self):
        return {"max_splats" if name == "splats" else name: value for name, value in self.options().items()}

    def arguments(self):
        return [word for name, value in self.options().items() for word in (f"--{name}", value)]


@dataclass
class Bench:
    """One run. `plan`: the settings to measure (speed.py). `extras`: the available ones of peers, flip, pictures."""

    programs: Path
    shared: Path
    out: Path
    work: Path
    plan: dict
    extras: set

    def run(self, program, *arguments):
        return output_of(self.programs / program, *arguments)

    def run_json(self, program, *arguments):
        return json.loads(self.run(program, *arguments))

    def mesh(self, name):
        return self.shared / "data" / f"{name}.vtu"

    def scene(self, view):
        return self.shared / "scenes" / f"{view}.json"

    def truth(self, view):
        return self.shared / "truth" / f"{view}.exr"

    def volume(self, mesh, connectivity="mesh"):
        return self.work / f"{mesh}-{connectivity}.svol"

    def picture_of(self, name, exr, background):
        """Keeps a picture for the page."""
        if "pictures" in self.extras:
            pictures.write_png(self.out / "pictures" / f"{name}.png", pictures.read_exr(exr), background)

    def difference_of(self, name, truth, exr):
        """Keeps the difference from the exact picture for the page."""
        if "pictures" in self.extras:
            path = self.out / "pictures" / f"{name}-difference.png"
            pictures.write_difference(path, pictures.read_exr(truth), pictures.read_exr(exr))

    def errors(self, truth, exr, background):
        difference = self.run_json("svdiff", truth, exr, "--json")
        mean_truth, mean = difference["mean"]
        row = {name: difference[name] for name in ("rmse", "psnr", "max", "ripple", "outline")}
        row["light"] = mean / mean_truth
        if "flip" in self.extras:
            row["flip"] = pictures.mean_flip(pictures.read_exr(truth), pictures.read_exr(exr), background)
        return row


def mesh_of(view):
    """Returns the mesh of a view. Views are named after their mesh: MESH or MESH-WHAT."""
    return view.partition("-")[0]


def write_csv(path, fields, rows):
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, fields)
        writer.writeheader()
        writer.writerows(rows)


# Builds.


def build(bench, mesh, connectivity="mesh"):
    """`connectivity`: that of svbuild, without cells; or CELLS: the mesh's, which are kept."""
    options = {CELLS: [], "mesh": ["--drop-cells"]}.get(connectivity, ["--drop-cells", "--connectivity", connectivity])
    runs = [
        bench.run_json("svbuild", bench.mesh(mesh), "-o", bench.volume(mesh, connectivity), *options, "--json")
        for _ in range(bench.plan["builds"])
    ]
    seconds = [r["seconds"] for r in runs]
    return {
        "mesh": mesh,
        "connectivity": connectivity,
        "points": runs[0]["points"],
        "resolutions": " ".join(map(str, runs[0]["resolutions"])),
        "seconds": statistics.median(seconds),
        "seconds_min": min(seconds),
        "seconds_max": max(seconds),
        "file_bytes": runs[0]["file_bytes"],
        "input_bytes": bench.mesh(mesh).stat().st_size,
    }


# Frames.


class Contender:
    """A setting or peer that takes turns.

    `first_picture` and `turn` return columns of the CSV. Those of `turn` are seconds: the result has their medians over
    the turns, and the least and the largest of frame_min_s and frame_max_s."""

    def __init__(self, bench, view, scene, truth, row, label):
        self.bench, self.scene, self.truth, self.label = bench, scene, truth, label
        self.background = json.loads(scene.read_text()).get("background", [0, 0, 0])
        self.row = {"view": view, "mesh": mesh_of(view), **row}
        self.turns = []

    def start(self):
        exr = self.bench.work / "picture.exr"
        self.row |= self.first_picture(exr)
        self.row |= self.bench.errors(self.truth, exr, self.background)
        if self.label:
            self.bench.picture_of(f"{self.row['view']}-{self.label}", exr, self.background)
        if self.label == "moments-0":
            self.bench.difference_of(f"{self.row['view']}-{self.label}", self.truth, exr)

    def take_turn(self, frames):
        self.turns.append(self.turn(frames))

    def result(self):
        best = {"frame_min_s": min, "frame_max_s": max}
        return self.row | {
            name: best.get(name, statistics.median)(turn[name] for turn in self.turns) for name in self.turns[0]
        }


class Splats(Contender):
    def __init__(self, bench, view, scene, truth, setting, connectivity="mesh", label=None):
        super().__init__(bench, view, scene, truth, {"connectivity": connectivity, **setting.row()}, label)
        self.volume = bench.volume(mesh_of(view), connectivity)
        self.setting = setting

    def arguments(self):
        return self.setting.arguments()

    def draw(self, exr, frames):
        options = ["--scene", self.scene, "-o", exr, "--repeat", frames, "--stats", "-", *self.arguments()]
        return self.bench.run_json("svrender", self.volume, *options)

    def first_picture(self, exr):
        stats = self.draw(exr, 1)
        self.renderer = stats["renderer"]
        names = ("sample_spacing", "splats", "nodes", "bytes_read", "file_bytes", "expected_error")
        return {name: stats[name] for name in names}

    def turn(self, frames):
        stats = self.draw(self.bench.work / "turn.exr", frames)
        names = ("frame", "frame_min", "frame_max", "cut", "sort", "draw")
        return {f"{name}_s": stats["seconds"][name] for name in names} | {"first_image_s": stats["first_image_seconds"]}


class Cells(Splats):
    """The mesh's own cells, drawn exactly by svrender."""

    def __init__(self, bench, view):
        row = {"connectivity": CELLS, "device": "cpu", "kernel": CELLS}
        Contender.__init__(self, bench, view, bench.scene(view), bench.truth(view), row, None)
        self.volume = bench.volume(mesh_of(view), CELLS)

    def arguments(self):
        return ["--exact"]

    def first_picture(self, exr):
        stats = self.draw(exr, 1)
        return {name: stats[name] for name in ("sample_spacing", "bytes_read", "file_bytes")}


# Asked for without another option.
ERRORS = (0.005, 0.0025)


class ByError(Cells):
    """svrender with no option but an error."""

    def __init__(self, bench, view, error):
        super().__init__(bench, view)
        self.error = error
        self.row |= {"part": "error", "kernel": "moments"}

    def arguments(self):
        return ["--max-error", self.error]

    def first_picture(self, exr):
        stats = self.draw(exr, 1)
        # A picture of cells has no splats.
        names = ("sample_spacing", "splats", "bytes_read", "file_bytes")
        return {"max_error": self.error, **{name: stats[name] for name in names if name in stats}}


class ByDefault(ByError):
    """The same with the error of a peer's picture. The peer starts first."""

    def __init__(self, bench, view, peer):
        super().__init__(bench, view, None)
        self.peer = peer
        self.row |= {"part": "default"}

    def first_picture(self, exr):
        self.error = self.peer.row["rmse"]
        return super().first_picture(exr)


class Exact(Contender):
    """svtruth, which follows every pixel's ray through every tetrahedron."""

    def __init__(self, bench, view):
        super().__init__(bench, view, bench.scene(view), bench.truth(view), {"kernel": "svtruth"}, None)

    def draw(self, exr, frames):
        mesh = self.bench.mesh(self.row["mesh"])
        return self.bench.run_json("svtruth", mesh, "--scene", self.scene, "-o", exr, "--repeat", frames, "--json")

    def first_picture(self, exr):
        return {"splats": self.draw(exr, 1)["tetrahedra"]}

    def turn(self, frames):
        stats = self.draw(self.bench.work / "turn.exr", frames)
        return {f"frame{which}_s": stats[f"seconds{which}"] for which in ("", "_min", "_max")}


class Growing(Splats):
    """As many splats of one volume as the setting says, with memory enough for all. There is no exact picture."""

    def __init__(self, bench, volume, scene, setting):
        Contender.__init__(self, bench, volume.stem, scene, None, {"connectivity": "boxes", **setting.row()}, None)
        self.volume = volume
        self.setting = setting

    def draw(self, exr, frames):
        options = ["--scene", self.scene, "--size", "512x512", "-o", exr, "--repeat", frames, "--stats", "-"]
        memory = ["--memory", "8G", "--gpu-memory", "8G"]
        return self.bench.run_json("svrender", self.volume, *options, *memory, *self.setting.arguments())

    def start(self):
        self.row |= self.first_picture(self.bench.work / "picture.exr")


class Peer(Contender):
    def __init__(self, bench, view, kind, process):
        super().__init__(bench, view, bench.scene(view), bench.truth(view), {"kernel": kind}, kind)
        self.kind, self.process = kind, process

    def first_picture(self, exr):
        first = self.process.prepare(self.kind, exr)
        self.renderer = f"VTK {first['version']}"
        return {"splats": first["cells"], "first_image_s": first["first_image_seconds"]}

    def turn(self, frames):
        seconds = self.process.frames(self.kind, frames)
        return {"frame_s": statistics.median(seconds), "frame_min_s": min(seconds), "frame_max_s": max(seconds)}


def take_turns(bench, part, points, contenders):
    for contender in contenders:
        contender.start()
    for _ in range(bench.plan["turns"]):
        for contender in contenders:
            contender.take_turn(bench.plan["frames"])
    return [{"part": part, "points": points, **contender.result()} for contender in contenders]


def settings(plan, kernel, finest):
    """Yields tolerances and the resolutions below the finest, each with every sampling. Then the other ways to sort,
    with all points, and the tolerances on other devices."""
    device, *others = plan["devices"]
    resolutions = range(finest - 1, max(finest - 1 - plan["resolutions"], -1), -1)
    for sampling in plan["samplings"]:
        yield from (Setting(kernel, t, sampling=sampling, device=device) for t in plan["tolerances"])
        yield from (Setting(kernel, resolution=r, sampling=sampling, device=device) for r in resolutions)
    yield from (Setting(kernel, 0, sort=sort, device=device) for sort in plan["sorts"] if sort != "exact")
    yield from (Setting(kernel, t, device=other) for other in others for t in plan["tolerances"])


def picture_label(plan, setting):
    """Returns the name of a setting's picture if the page shows it, else None."""
    usual = setting.sort == "exact" and setting.sampling == "auto" and setting.device == plan["devices"][0]
    shown = usual and setting.resolution is None and setting.tolerance in plan["pictured_tolerances"]
    return f"{setting.kernel}-{setting.tolerance:g}" if shown else None


def measure_view(bench, view, finest, points, note):
    scene, truth = bench.scene(view), bench.truth(view)
    contenders = [
        Splats(bench, view, scene, truth, setting, label=picture_label(bench.plan, setting))
        for kernel in bench.plan["kernels"]
        for setting in settings(bench.plan, kernel, finest)
    ]
    bench.picture_of(f"{view}-exact", truth, contenders[0].background)
    with ExitStack() as stack:
        contenders += [Cells(bench, view), Exact(bench, view)]
        contenders += [ByError(bench, view, error) for error in ERRORS]
        if "peers" in bench.extras:
            process = stack.enter_context(peers.Peers(bench.mesh(mesh_of(view)), scene))
            contenders += [Peer(bench, view, kind, process) for kind in peers.KINDS]
            contenders.append(ByDefault(bench, view, contenders[-len(peers.KINDS)]))
        rows = take_turns(bench, "view", points, contenders)
    note["renderers"] = {c.setting.device: c.renderer for c in contenders if type(c) is Splats}
    if "peers" in bench.extras:
        note["peers"] = contenders[-1].peer.renderer
    return rows


def measure_equal(bench, view, finest, points):
    """Measures tolerances and fixed resolutions, each followed by the cut by expected error with as many splats.
    Measures no times."""
    plan, kernel, device = bench.plan, bench.plan["kernel"], bench.plan["devices"][0]
    plain = [Setting(kernel, tolerance, sampling="1", device=device) for tolerance in plan["equal_tolerances"]]
    plain += [Setting(kernel, resolution=r, sampling="1", device=device) for r in range(1, finest)]
    for setting in plain:
        contender = Splats(bench, view, bench.scene(view), bench.truth(view), setting)
        contender.start()
        by_error = Setting(kernel, splats=contender.row["splats"], sampling="1", device=device)
        other = Splats(bench, view, bench.scene(view), bench.truth(view), by_error)
        other.start()
        yield from ({"part": "equal", "points": points, **c.row} for c in (contender, other))


def measure_scattered(bench, view, points):
    """Measures the mesh with its own cells, and the same points without them, against the mesh's exact picture."""
    scene, truth = bench.scene(view), bench.truth(view)
    contenders = [
        Splats(bench, view, scene, truth, Setting(bench.plan["kernel"], device=bench.plan["devices"][0]), connectivity)
        for connectivity in ("mesh", *bench.plan["connectivities"])
    ]
    return take_turns(bench, "scattered", points, contenders)


def measure_lit(bench, view, points):
    """Measures the scene with a light at the eye, and makes its exact picture."""
    scene, truth = bench.work / f"{view}-lit.json", bench.work / f"{view}-lit.exr"
    description = json.loads(bench.scene(view).read_text()) | {"lighting": True}
    scene.write_text(json.dumps(description))
    bench.run("svtruth", bench.mesh(mesh_of(view)), "--scene", scene, "-o", truth)
    if "octant" in bench.plan["kernels"]:  # which needs gradients for its light
        bench.run("svbuild", bench.mesh(mesh_of(view)), "-o", bench.volume(mesh_of(view)), "--gradients", "--drop-cells")
    bench.picture_of(f"{view}-lit-exact", truth, description.get("background", [0, 0, 0]))
    contenders = [
        Splats(bench, view, scene, truth, Setting(kernel, device=bench.plan["devices"][0]), label=f"lit-{kernel}")
        for kernel in bench.plan["kernels"]
    ]
    return take_turns(bench, "lit", points, contenders)


def measure_growth(bench):
    """Measures frames of more and more splats of many points. Only the first device draws all of them."""
    growth, kernel = bench.plan["growth"], "moments"
    volume, scene = bench.work / "vortex.svol", bench.work / "vortex.json"
    points = bench.run_json("svbuild", growth["source"], "--connectivity", "boxes", "-o", volume, "--json")["points"]
    bench.run("svinfo", volume, "--scene", scene)
    settings = [
        Setting(kernel, splats=count, sampling="1", device=device)
        for count in growth["splats"]
        for device in bench.plan["devices"]
    ]
    settings.append(Setting(kernel, 0, sampling="1", device=bench.plan["devices"][0]))
    return take_turns(bench, "growth", points, [Growing(bench, volume, scene, setting) for setting in settings])


def measure_reference(bench, view):
    """Compares svtruth with the exact picture that came with the data."""
    exr = bench.work / "truth.exr"
    stats = bench.run_json("svtruth", bench.mesh(mesh_of(view)), "--scene", bench.scene(view), "-o", exr, "--json")
    difference = bench.run_json("svdiff", bench.truth(view), exr, "--json")
    return {
        "view": view,
        **{k: stats[k] for k in ("tetrahedra", "segments_per_pixel", "seconds")},
        **{k: difference[k] for k in ("rmse", "max")},
    }


def measure_builds(bench, say):
    """Builds every mesh, and those of the part `scattered` without their cells too."""
    for mesh in dict.fromkeys(map(mesh_of, bench.plan["views"])):
        without_cells = bench.plan["connectivities"] if mesh in bench.plan["scattered"] else []
        for connectivity in (CELLS, "mesh", *without_cells):
            say(f"build {mesh}, {connectivity}")
            yield build(bench, mesh, connectivity)


def measure_frames(bench, view, points, finest, note, say):
    say(f"view {view}")
    yield from measure_view(bench, view, finest, points, note)
    if view in bench.plan["equal"]:
        say(f"equal splats {view}")
        yield from measure_equal(bench, view, finest, points)
    if view in bench.plan["scattered"]:
        say(f"scattered {view}")
        yield from measure_scattered(bench, view, points)
    if view in bench.plan["lit"]:
        say(f"lit {view}")
        yield from measure_lit(bench, view, points)


def measure(programs, shared, out, plan, extras, say):
    """Writes builds.csv, frames.csv, reference.csv, run.json and pictures/ in `out`. Writes them again after each view,
    so that the results so far stay if a later view fails. `say` gets a line for each task."""
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    for old in (out / "pictures").glob("*.png"):
        old.unlink()
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        bench = Bench(programs, shared, out, Path(work), plan, extras)
        note = {
            "software": bench.run("svrender", "--version").strip(),
            "processor": processor(),
            "cores": os.cpu_count(),
            "load_before": os.getloadavg()[0],
            "plan": plan,
            "extras": sorted(extras),
        }
        builds = list(measure_builds(bench, say))
        resolutions = {b["mesh"]: len(b["resolutions"].split()) for b in builds}
        points = {b["mesh"]: b["points"] for b in builds}
        write_csv(out / "builds.csv", BUILD_FIELDS, builds)

        frames, references = [], []
        for view in plan["views"]:
            mesh = mesh_of(view)
            frames += measure_frames(bench, view, points[mesh], resolutions[mesh] - 1, note, say)
            if view in plan["reference"]:
                say(f"reference {view}")
                references.append(measure_reference(bench, view))
            write_csv(out / "frames.csv", FRAME_FIELDS, frames)
            write_csv(out / "reference.csv", REFERENCE_FIELDS, references)
            (out / "run.json").write_text(json.dumps(note, indent=1) + "\n")
        if plan["growth"]:
            say("growth")
            frames += measure_growth(bench)
            write_csv(out / "frames.csv", FRAME_FIELDS, frames)
