"""Makes the page of results from the CSV files that measure.py writes."""

import csv
import json
import math
import shutil
from dataclasses import dataclass

from .common import table_head, wrapped

PEER_NAMES = {"projected-tets": "VTK projected tetrahedra", "ray-cast": "VTK ray cast"}
CELLS = "cells"
EXACT = "svtruth"
NAMES = PEER_NAMES | {CELLS: "`svrender --exact`", EXACT: "`svtruth`"}
TEXT = {"part", "view", "mesh", "connectivity", "device", "kernel", "sort", "sampling", "resolutions"}


class Row(dict):
    """A line of a CSV file, with its columns as attributes."""

    __getattr__ = dict.__getitem__


def read_csv(path):
    """Reads rows. Numbers become float; an empty cell becomes None."""
    with open(path, newline="") as file:
        lines = list(csv.DictReader(file))
    return [Row({k: v if k in TEXT else (float(v) if v else None) for k, v in line.items()}) for line in lines]


class Results:
    def __init__(self, folder):
        self.folder = folder
        self.frames = read_csv(folder / "frames.csv")
        self.builds = read_csv(folder / "builds.csv")
        self.reference = read_csv(folder / "reference.csv")
        self.note = json.loads((folder / "run.json").read_text())
        self.plan = self.note["plan"]
        self.views = list(dict.fromkeys(row.view for row in self.frames if row.part == "view"))
        self.devices = self.plan["devices"]
        self.device = self.devices[0]  # which draws all settings
        self.kernels = self.plan["kernels"]
        self.kernel = self.plan["kernel"]  # the kernel to compare with others

    def of(self, part="view", **columns):
        return [row for row in self.frames if row.part == part and all(row[k] == v for k, v in columns.items())]

    def one(self, part="view", **columns):
        return next(iter(self.of(part, **columns)), None)

    def by_tolerance(self, view, tolerance, kernel, **columns):
        """Returns a usual frame of a tolerance, but for the columns named."""
        usual = {"sort": "exact", "sampling": "auto", "device": self.device}
        return self.one(view=view, tolerance=tolerance, kernel=kernel, **(usual | columns))

    def all_points(self, view, kernel, **columns):
        return self.by_tolerance(view, 0, kernel, **columns)



# Text.


def paragraph(text):
    return [*wrapped(text), ""]


def wrapped_item(text):
    first, *rest = wrapped(text)
    return [first, *(f"  {line}" for line in rest)]


def table(columns, rows):
    """Makes a Markdown table. `columns`: pairs of a title and a function from a row to its cell (None: empty)."""
    lines = table_head(*(title for title, _ in columns))
    for row in rows:
        cells = (cell(row) for _, cell in columns)
        lines.append("| " + " | ".join("" if cell is None else str(cell) for cell in cells) + " |")
    return [*lines, ""]


def text(name):
    return lambda row: row[name]


def number(name, form=".0f", scale=1):
    return lambda row: None if row[name] is None else format(scale * row[name], form)


def milliseconds(row):
    return f"{1e3 * row.frame_s:.1f} ({1e3 * row.frame_min_s:.1f}-{1e3 * row.frame_max_s:.1f})"


def kernel_name(row):
    return NAMES.get(row.kernel, f"`{row.kernel}`")


def setting(row):
    if row.kernel in NAMES:
        return None
    if row.get("max_splats") is not None:
        words = [f"{row.max_splats:.0f} splats"]
    else:
        words = [f"{row.tolerance:g} %" if row.tolerance is not None else f"resolution {row.resolution:.0f}"]
    if row.sort != "exact":
        words.append(f"sort {row.sort}")
    if row.sample_spacing > 1:
        words.append(f"samples {row.sample_spacing:.0f} pixels apart")
    return ", ".join(words)


VIEW = ("view", text("view"))
KERNEL = ("kernel", kernel_name)
SPLATS = ("splats", number("splats"))
FRAME = ("frame ms", milliseconds)
RMSE = ("RMSE", number("rmse", ".4f"))
FLIP = ("FLIP", number("flip", ".4f"))
RIPPLE = ("ripple", number("ripple", ".5f"))
LIGHT = ("light", number("light", ".3f"))


# Against the peers.


@dataclass
class Match:
    """A view's peer, our fastest setting that is as close to the exact picture, and our setting with all points."""

    view: str
    peer: Row
    fastest: Row | None
    finest: Row

    @property
    def gain(self):
        return self.peer.frame_s / self.fastest.frame_s if self.fastest else None

    @property
    def finest_error(self):
        return self.finest.rmse / self.peer.rmse


def keeps_light(peer):
    """Whether a peer's picture has about the light of the exact one. If not, it is easy to be closer."""
    return 0.8 <= peer.light <= 1.25


def matches(results, kind, widest=math.inf):
    """Yields a Match for each view. `widest`: the largest distance of samples to consider, in pixels."""
    for view in results.views:
        peer, finest = results.one(view=view, kernel=kind), results.all_points(view, results.kernel)
        if peer is None or finest is None:
            continue
        ours = results.of(view=view, kernel=results.kernel, device=results.device)
        ours = [row for row in ours if row.sample_spacing <= widest]
        as_close = [row for row in ours if row.rmse <= peer.rmse]
        yield Match(view, peer, min(as_close, key=lambda row: row.frame_s, default=None), finest)


def geometric_mean(ratios):
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def gains(found):
    ratios = [match.gain for match in found if match.fastest]
    reached = f"{len(ratios)} of {len(found)} views"
    return f"{geometric_mean(ratios):.1f} times ({reached})" if ratios else reached


def against_peers(results):
    found = {kind: list(matches(results, kind)) for kind in PEER_NAMES}
    found = {kind: of for kind, of in found.items() if of}
    if not found:
        return ["## Against VTK", "", "Not measured in this run.", ""]
    lines = []
    columns = [("view", lambda pair: pair[0].view)]
    for place, kind in enumerate(found):
        lines.append(
            f"- {PEER_NAMES[kind]}: {gains(found[kind])}. Where VTK keeps the light within a fifth: "
            f"{gains([match for match in found[kind] if keeps_light(match.peer)])}. With a sample for every pixel: "
            f"{gains(list(matches(results, kind, widest=1)))}. With all points: our RMSE over VTK's "
            f"{geometric_mean([match.finest_error for match in found[kind]]):.3f}."
        )

        def fastest(say, place=place):
            return lambda pair: pair[place].fastest and say(pair[place].fastest)

        columns += [
            (f"at the RMSE of {PEER_NAMES[kind]}", fastest(setting)),
            ("splats", fastest(SPLATS[1])),
            ("frame ms", fastest(milliseconds)),
            ("RMSE", fastest(RMSE[1])),
            ("VTK's light", lambda pair, place=place: LIGHT[1](pair[place].peer)),
            ("times faster", lambda pair, place=place: pair[place].gain and f"{pair[place].gain:.1f}"),
        ]
    return [
        "## Against VTK",
        "",
        *paragraph(f"""The fastest measured setting of `{results.kernel}` with an RMSE of at most that of VTK's picture.
            Geometric means of the ratios of frame times:"""),
        *(line for text in lines for line in wrapped_item(text)),
        "",
        *table(columns, list(zip(*found.values()))),
    ]


# What a user gets without options.


def by_default(results):
    peers = [(view, results.one(view=view, kernel="projected-tets")) for view in results.views]
    pairs = [pair for view, peer in peers if all(pair := (peer, results.one("default", view=view)))]
    if not pairs:
        return []

    def gain(pair):
        return pair[0].frame_s / pair[1].frame_s

    def mean(kept):
        if not kept:
            return "no view"
        return f"{geometric_mean([gain(pair) for pair in kept]):.0f} times (of {len(kept)} views)"

    columns = [
        ("view", lambda pair: pair[0].view),
        ("VTK: frame ms", lambda pair: milliseconds(pair[0])),
        ("RMSE", lambda pair: f"{pair[0].rmse:.4f}"),
        ("light", lambda pair: f"{pair[0].light:.3f}"),
        ("`svrender`: frame ms", lambda pair: milliseconds(pair[1])),
        ("RMSE", lambda pair: f"{pair[1].rmse:.4f}"),
        ("light", lambda pair: f"{pair[1].light:.3f}"),
        ("drawn", lambda pair: drawn(pair[1])),
        ("first picture ms", lambda pair: f"{1e3 * pair[1].first_image_s:.0f}"),
        ("times faster", lambda pair: f"{gain(pair):.0f}"),
    ]
    return [
        "## By default, at VTK's error",
        "",
        *paragraph(f"""`svrender FILE --scene SCENE --max-error E --repeat {results.plan["frames"]}` without any other
            option, where E is the RMSE of VTK's projected tetrahedra. The first picture includes opening the file and
            the search for the picture of the least work that has this error. Geometric means of VTK's frame times over
            ours:"""),
        f"- all views: {mean(pairs)}",
        f"- views where VTK keeps the light within a fifth: {mean([pair for pair in pairs if keeps_light(pair[0])])}",
        "",
        *table(columns, pairs),
    ]


def drawn(row):
    what = "cells" if row.splats is None else f"{row.splats:.0f} splats"
    return what if row.sample_spacing == 1 else f"{what}, samples {row.sample_spacing:.0f} pixels apart"


def by_error(results):
    rows = results.of("error")
    if not rows:
        return []
    columns = [
        VIEW,
        ("wanted", number("max_error", "g")),
        RMSE,
        ("drawn", drawn),
        FRAME,
        ("first picture ms", number("first_image_s", ".0f", 1e3)),
    ]
    means = [
        f"- {error:g}: {1e3 * geometric_mean([row.frame_s for row in rows if row.max_error == error]):.1f} ms"
        for error in sorted({row.max_error for row in rows}, reverse=True)
    ]
    cells = [results.one(view=view, kernel=CELLS) for view in results.views]
    means.append(f"- exactly (`--exact`): {1e3 * geometric_mean([row.frame_s for row in cells]):.1f} ms")
    return [
        "## By an error",
        "",
        *paragraph("`svrender FILE --scene SCENE --max-error E` without another option. Geometric means of frame times:"),
        *means,
        "",
        *table(columns, rows),
    ]


# All points on all devices, beside everything else.


def all_beside(results):
    columns = [("view", lambda view: view)]
    kernel = results.kernel
    contenders = [
        (f"`{kernel}`, {device}", lambda view, device=device: results.all_points(view, kernel, device=device))
        for device in results.devices
    ]
    contenders += [
        (name, lambda view, kind=kind: results.one(view=view, kernel=kind)) for kind, name in NAMES.items()
    ]
    ratios = []
    for title, find in contenders:
        rows = [(results.all_points(view, results.kernel), find(view)) for view in results.views]
        if any(row is None for pair in rows for row in pair):
            continue
        columns.append((f"{title}: frame ms", lambda view, find=find: milliseconds(find(view))))
        columns.append(("RMSE", lambda view, find=find: f"{find(view).rmse:.1e}"))
        ratios.append((title, geometric_mean([other.frame_s / ours.frame_s for ours, other in rows])))
    if not ratios:
        return []
    return [
        "## All points, by device, beside VTK and exact pictures",
        "",
        *paragraph(f"""`svrender --tolerance 0 --device DEVICE` draws splats, and `svrender --exact` the cells that the
            file keeps. Beside them VTK's mappers, and `svtruth`, which draws the exact picture from the mesh: its error
            is 0 by definition, and the RMSE is that against an independent program. Geometric
            means of frame times over those of `{results.kernel}`, {results.device}:
            {", ".join(f"{title} {ratio:.2f}" for title, ratio in ratios[1:]) or "no others"}."""),
        *table(columns, results.views),
    ]


def growth(results):
    rows = results.of("growth")
    if not rows:
        return []
    columns = [
        ("device", text("device")),
        ("setting", setting),
        SPLATS,
        FRAME,
        ("cut ms", number("cut_s", ".1f", 1e3)),
        ("sort ms", number("sort_s", ".1f", 1e3)),
        ("draw ms", number("draw_s", ".1f", 1e3)),
        ("ns a splat", lambda row: f"{1e9 * row.frame_s / row.splats:.0f}"),
    ]
    return [
        "## More and more splats",
        "",
        *paragraph(f"""`{results.plan['growth']['source']}`: {rows[0].points:.0f} points, 512 x 512 pixels, the first
            scene, a sample for every pixel, `--splats N` and all points. The data is resident and the camera
            moves."""),
        *table(columns, rows),
    ]


# Smaller sections.


def equal(results):
    rows = results.of("equal")
    if not rows:
        return []
    pairs = [(plain, by_error) for plain, by_error in zip(rows[::2], rows[1::2])]

    def gain(which):
        ratios = [plain.rmse / by_error.rmse for plain, by_error in pairs if plain[which] is not None]
        return f"{geometric_mean(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"

    offsets = [by_error.expected_error / by_error.rmse for _, by_error in pairs]
    return [
        "## By expected error, at equal splats",
        "",
        *paragraph(f"""Each tolerance and fixed resolution of `{results.kernel}` beside `--splats` with as many splats,
            a sample for every pixel. RMSE over that by expected error, geometric means (smallest to largest):
            tolerances {gain("tolerance")}, fixed resolutions {gain("resolution")}. The expected error over the true
            one: {geometric_mean(offsets):.2f} ({min(offsets):.2f} to {max(offsets):.2f})."""),
    ]


def sorting(results):
    def over_exact(kernel, sort, which):
        pairs = [[results.all_points(view, kernel, sort=s) for s in (sort, "exact")] for view in results.views]
        ratios = [other[which] / exact[which] for other, exact in pairs if other and exact]
        return f"{geometric_mean(ratios):.2f}" if ratios else None

    columns = [("kernel", lambda kernel: f"`{kernel}`")]
    for sort in results.plan["sorts"]:
        if sort != "exact":
            for title, which in (("frame time", "frame_s"), ("RMSE", "rmse")):
                columns.append((f"{sort}: {title}", lambda kernel, s=sort, w=which: over_exact(kernel, s, w)))
    return [
        "## Sorting",
        "",
        *paragraph(
            """All points, the camera moving. `none`: back to front by node only. `axis`: by depth along the axis
            nearest to the line of sight, kept while the view turns little. `exact`: every splat by its own depth.
            Geometric means of the views, over those of `exact`:"""
        ),
        *table(columns, results.kernels),
    ]


def building(results):
    columns = [
        ("mesh", text("mesh")),
        ("connectivity", text("connectivity")),
        ("points", number("points")),
        ("resolutions", lambda b: b.resolutions.replace(" ", ", ")),
        ("seconds", lambda b: f"{b.seconds:.2f} ({b.seconds_min:.2f}-{b.seconds_max:.2f})"),
        ("bytes", number("file_bytes")),
        ("bytes a point", lambda b: f"{b.file_bytes / b.points:.1f}"),
        ("bytes of the .vtu", number("input_bytes")),
    ]
    return [
        "## Building",
        "",
        *paragraph(f"""`svbuild MESH.vtu -o MESH.svol`, all attributes, {results.plan['builds']} runs each, reading the
            mesh included. Files of the connectivity cells keep the mesh's cells, by default; all others are built with
            `--drop-cells`. `--connectivity` other than mesh leaves the mesh's cells aside: scattered points. Larger
            inputs, and views of them, are in [scale.md](scale.md)."""),
        *table(columns, results.builds),
    ]


def scattered(results):
    rows = results.of("scattered")
    if not rows:
        return []
    return [
        "## Scattered points",
        "",
        *paragraph(f"""The same points without the cells (`svbuild --connectivity`), all of them drawn with
            `{results.kernel}`, against the exact picture of the mesh. Without cells nothing tells a hole or a concavity
            from the inside."""),
        *table([VIEW, ("connectivity", text("connectivity")), SPLATS, FRAME, RMSE, FLIP, RIPPLE, LIGHT], rows),
    ]


def lit(results):
    rows = results.of("lit")
    if not rows:
        return []
    return [
        "## Lit",
        "",
        *paragraph("""A light at the eye (`"lighting": true`), all points, against `svtruth`."""),
        *table([VIEW, KERNEL, FRAME, RMSE, FLIP, RIPPLE, LIGHT], rows),
    ]


def reference(results):
    if not results.reference:
        return []
    worst = max(results.reference, key=lambda row: row.rmse)
    others = max((row.rmse for row in results.reference if row is not worst), default=0)
    return [
        "## Reference",
        "",
        *paragraph(f"""`svtruth` against pictures by an independent program (another algorithm, also in double
            precision): an RMSE of {worst.rmse:.2e} for {worst.view} (largest difference {worst.max:.2e}), and of at
            most {others:.2e} for the other views."""),
    ]


# Pictures, plots and tables beside the page.

SHOWN = {
    "bluntfin-close-exact": "exact",
    "bluntfin-close-moments-5": "`moments`, 5 %",
    "bluntfin-close-projected-tets": PEER_NAMES["projected-tets"],
}
SHOWN_IN_ACCURACY = [f"{mesh}-moments-0-difference" for mesh in ("bluntfin", "post")]
TABLES = ("frames.csv", "builds.csv", "reference.csv", "run.json")


def gallery(results, docs):
    """Copies the pictures that pages show. Returns the table of this page's."""
    (docs / "pictures").mkdir(parents=True, exist_ok=True)
    for name in (*SHOWN, *SHOWN_IN_ACCURACY):
        if (made := results.folder / f"pictures/{name}.png").exists():
            shutil.copy(made, docs / "pictures")
    shown = [name for name in SHOWN if (docs / f"pictures/{name}.png").exists()]
    columns = [(SHOWN[name], lambda _, name=name: f"![{name}](pictures/{name}.png)") for name in shown]
    return ["bluntfin-close:", "", *table(columns, [None])] if shown else []


def all_measurements(results, docs):
    """Copies the tables. Returns the section that names them."""
    (docs / "results").mkdir(parents=True, exist_ok=True)
    if results.folder.resolve() != (docs / "results").resolve():
        for name in TABLES:
            shutil.copy(results.folder / name, docs / "results")
    return [
        "## All measurements",
        "",
        *paragraph(
            """A line for each picture is in [frames.csv](results/frames.csv), for each build in
            [builds.csv](results/builds.csv), and for each view of `svtruth` in
            [reference.csv](results/reference.csv); the settings are in [run.json](results/run.json)."""
        ),
        *paragraph(
            """Times are in seconds. RMSE and PSNR are of linear RGB. FLIP is the mean over the sRGB pictures on the
            background. Light is the mean of the picture over that of the exact one. The first picture includes
            everything from opening the file to the finished pixels, and for `svrender --device gl` also starting OpenGL
            and compiling shaders. VTK has the mesh in memory already; its `splats`, and those of `svtruth`, are cells.
            Frame, cut, sort and draw are of steady frames. `bench/svbench report -o docs/results` makes this page of
            these files."""
        ),
    ]


def head(results):
    note, plan = results.note, results.plan
    with_peers = f"; {note['peers']} with the same OpenGL" if "peers" in note else ""
    renderers = "; ".join(f"{device}: {renderer}" for device, renderer in note["renderers"].items())
    return [
        "# Results",
        "",
        *paragraph(f"""Made by `bench/svbench speed --shared SHARED --devices {",".join(plan["devices"])}
            --turns {plan["turns"]}`:
            {note['software']}, {note['cores']} cores of {note['processor']}; {renderers}{with_peers}. Load of the
            machine before the run: {note['load_before']:.2f}."""),
    ]


def method(results, plotted):
    plan = results.plan
    left_out = sorted({"peers", "flip", "pictures"} - set(results.note["extras"])) + ([] if plotted else ["plots"])
    lines = [
        "## How it was measured",
        "",
        *paragraph(f"""The settings of a view and the peers took turns ({plan['turns']}, of {plan['frames']} frames
            each), so that other work of the machine hits all alike. A time is the median of the turns' medians
            (fastest-slowest frame). Pictures have the size that their scene says. Frames are steady ones: the data is
            resident and the camera moves. Samples of a picture may be farther apart than pixels; the picture is then
            interpolated (`svrender --sampling`). With `--max-error` and from a
            tolerance of 5 % on, `svrender` does so by default."""),
        *paragraph("""VTK's mappers take opacities in [0, 1]: density over the largest density. The inverse of the
            largest density is the `ScalarOpacityUnitDistance`. The mappers keep opacities in 8 bits and draw to 8 bits,
            which alone costs about .001. With very thin cells, or with the eye inside the data, they lose most of the
            light or gain too much. The column `light` shows this: compare times there with care. The ray caster sends a
            ray through every pixel, whatever the cost. VTK's z-sweep mapper takes several times as long and is left
            out."""),
    ]
    if left_out:
        lines += [f"**Left out of this run: {', '.join(left_out)}.**", ""]
    if plotted:
        lines += paragraph("""Lower left is better. Filled marks are tolerances, hollow ones fixed resolutions. Crosses
            are both, with samples of the picture 4 pixels apart. All are sorted exactly.""")
        lines += ["![error-time](plots/error-time.png)", ""]
    return lines


def write(results, docs, plotted):
    """Writes results.md, results/ and pictures/ in `docs`. `plotted`: whether there is a plot."""
    docs.mkdir(parents=True, exist_ok=True)
    lines = head(results) + by_default(results) + by_error(results) + method(results, plotted) + gallery(results, docs)
    for section in (all_beside, against_peers, growth):
        lines += section(results)
    for section in (equal, sorting, building, scattered, lit, reference):
        lines += section(results)
    lines += all_measurements(results, docs)
    (docs / "results.md").write_text("\n".join(lines).rstrip() + "\n")
