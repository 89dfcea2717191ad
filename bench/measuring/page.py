"""Makes the page of results from the CSV files that measure.py writes."""

import csv
import json
import math
import shutil
import textwrap
from dataclasses import dataclass
from pathlib import Path

PEER_NAMES = {"projected-tets": "VTK projected tetrahedra", "ray-cast": "VTK ray cast"}
EXACT = "svtruth"
NAMES = PEER_NAMES | {EXACT: "`svtruth`: exact"}
TEXT = {"part", "view", "mesh", "connectivity", "device", "kernel", "sort", "raster", "sampling", "resolutions"}


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
        self.prototype = json.loads(Path(__file__).with_name("prototype.json").read_text())
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
        usual = {"sort": "exact", "raster": "splats", "sampling": "auto", "device": self.device}
        return self.one(view=view, tolerance=tolerance, kernel=kernel, **(usual | columns))

    def all_points(self, view, kernel, **columns):
        return self.by_tolerance(view, 0, kernel, **columns)

    def counts(self, view):
        """Points of each resolution of the view's mesh, coarse to fine."""
        mesh = self.one(view=view).mesh
        return next([int(n) for n in b.resolutions.split()] for b in self.builds if b.mesh == mesh)


# Text.


def paragraph(text):
    return [*textwrap.wrap(" ".join(text.split()), 120, break_long_words=False, break_on_hyphens=False), ""]


def table(columns, rows):
    """Makes a Markdown table. `columns`: pairs of a title and a function from a row to its cell (None: empty)."""
    lines = ["| " + " | ".join(title for title, _ in columns) + " |", "|" + "---|" * len(columns)]
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
    if row.raster != "splats":
        words.append(row.raster)
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
OUTLINE = ("outline", number("outline", ".4f"))
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
    def finest_gain(self):
        return self.peer.frame_s / self.finest.frame_s

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


def against_peer(results, kind):
    name, found = PEER_NAMES[kind], list(matches(results, kind))
    if not found:
        return [f"## Against {name}", "", "Not measured in this run.", ""]

    def fastest(say):
        return lambda match: match.fastest and say(match.fastest)

    peer_columns = [
        ("VTK: frame ms", lambda match: milliseconds(match.peer)),
        ("RMSE", lambda match: f"{match.peer.rmse:.4f}"),
        ("light", lambda match: f"{match.peer.light:.3f}"),
    ]
    fastest_columns = [
        ("view", lambda match: match.view),
        ("setting", lambda match: setting(match.fastest) if match.fastest else "none"),
        ("splats", fastest(SPLATS[1])),
        ("frame ms", fastest(milliseconds)),
        ("RMSE", fastest(RMSE[1])),
        *peer_columns,
        ("times faster", lambda match: match.gain and f"{match.gain:.1f}"),
    ]
    finest_columns = [
        ("view", lambda match: match.view),
        ("all points: frame ms", lambda match: milliseconds(match.finest)),
        ("RMSE", lambda match: f"{match.finest.rmse:.4f}"),
        *peer_columns,
        ("times faster", lambda match: f"{match.finest_gain:.1f}"),
        ("RMSE over VTK's", lambda match: f"{match.finest_error:.3f}"),
    ]
    return [
        f"## Against {name}",
        "",
        *paragraph(
            f"""The fastest measured setting of `{results.kernel}` with an RMSE of at most that of {name}. Geometric
            mean of the ratios of frame times:"""
        ),
        f"- all views: {gains(found)}",
        f"- views where VTK keeps the light within a fifth: {gains([m for m in found if keeps_light(m.peer)])}",
        f"- all views, a sample for every pixel: {gains(list(matches(results, kind, widest=1)))}",
        "",
        *table(fastest_columns, found),
        *paragraph(f"""With all points (tolerance 0), geometric means: VTK's time over ours
            {geometric_mean([match.finest_gain for match in found]):.1f}, our RMSE over VTK's
            {geometric_mean([match.finest_error for match in found]):.3f}."""),
        *table(finest_columns, found),
    ]


# What a user gets without options.


def by_default(results):
    pairs = [(results.one(view=view, kernel="projected-tets"), results.one("default", view=view)) for view in results.views]
    pairs = [pair for pair in pairs if all(pair)]
    if not pairs:
        return []

    def gain(pair):
        return pair[0].frame_s / pair[1].frame_s

    def mean(kept):
        return f"{geometric_mean([gain(pair) for pair in kept]):.0f} times (of {len(kept)} views)" if kept else "no view"

    columns = [
        ("view", lambda pair: pair[0].view),
        ("VTK: frame ms", lambda pair: milliseconds(pair[0])),
        ("RMSE", lambda pair: f"{pair[0].rmse:.4f}"),
        ("light", lambda pair: f"{pair[0].light:.3f}"),
        ("`svrender`: frame ms", lambda pair: milliseconds(pair[1])),
        ("RMSE", lambda pair: f"{pair[1].rmse:.4f}"),
        ("light", lambda pair: f"{pair[1].light:.3f}"),
        ("splats", lambda pair: SPLATS[1](pair[1])),
        ("first picture ms", lambda pair: f"{1e3 * pair[1].first_image_s:.0f}"),
        ("times faster", lambda pair: f"{gain(pair):.0f}"),
    ]
    return [
        "## By default, at VTK's error",
        "",
        *paragraph(f"""`svrender FILE --scene SCENE --max-error E --repeat {results.plan["frames"]}` without any other
            option, where E is the RMSE of VTK's projected tetrahedra. The first picture includes opening the file and
            the search for the fewest splats that have this error. Geometric means of VTK's frame times over ours:"""),
        f"- all views: {mean(pairs)}",
        f"- views where VTK keeps the light within a fifth: {mean([pair for pair in pairs if keeps_light(pair[0])])}",
        "",
        *table(columns, pairs),
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
        *paragraph(f"""`svrender --tolerance 0 --device DEVICE`, VTK's mappers, and `svtruth`, which draws the exact
            picture: its error is 0 by definition, and the RMSE is that against an independent program. Geometric
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


# Against the prototype.


def slabs(results):
    """Splats drawn one over the other beside splats mixed in slabs."""
    tolerances = [t for t in (0, 5, 10) if t in results.plan["tolerances"]]
    pairs = [
        [results.by_tolerance(view, t, "moments", raster=raster) for raster in ("splats", "slabs")]
        for t in tolerances
        for view in results.views
    ]
    pairs = [pair for pair in pairs if all(pair)]
    if not pairs:
        return []

    def ratio(which):
        of_all_points = [pair for pair in pairs if pair[0].tolerance == 0 and pair[0][which]]
        return f"{geometric_mean([mixed[which] / plain[which] for plain, mixed in of_all_points]):.2f}"

    columns = [("view", lambda pair: pair[0].view), ("setting", lambda pair: setting(pair[0]))]
    for place, title in enumerate(("splats", "slabs")):
        for name, say in (FRAME, RMSE, RIPPLE, OUTLINE):
            columns.append((f"{title}: {name}", lambda pair, place=place, say=say: say(pair[place])))
    return [
        "## Mixed in slabs",
        "",
        *paragraph(f"""`--raster splats` draws one splat over the other; `--raster slabs` mixes them (docs/accuracy.md).
            Ripple is the error beside the outline of the exact picture that is narrower than about 16 pixels, outline
            the error within 3 pixels of it (`svdiff`). Section Pictures shows the differences. Geometric means with all points, slabs over splats: frame times
            {ratio("frame_s")}, RMSE {ratio("rmse")}, ripple {ratio("ripple")}, outline {ratio("outline")}."""),
        *table(columns, pairs),
    ]


def beside_prototype(results):
    """Yields the rows of fixed resolutions for which the prototype has a figure, finest first."""
    for view in results.views:
        counts = results.counts(view)
        for step, (figure, bar) in enumerate(zip(results.prototype["rmse"].get(view, []), results.prototype["bars"])):
            resolution = len(counts) - 1 - step
            fixed = results.one(
                view=view, kernel="moments", resolution=resolution, sampling="auto", device=results.device
            )
            if row := fixed if step else results.all_points(view, "moments"):
                share, ratio = counts[resolution] / counts[-1], row.rmse / figure
                yield Row(row, resolution=resolution, share=share, figure=figure, ratio=ratio, bar=bar)


def verdict(row):
    return row.bar and (f"{row.bar}, kept" if row.ratio <= row.bar else f"{row.bar}, **missed**")


def against_prototype(results):
    rows = list(beside_prototype(results))
    if not rows:
        return ["## Resolutions, against the prototype", "", "Not measured in this run.", ""]
    barred = [row for row in rows if row.bar]
    columns = [
        VIEW,
        ("resolution", number("resolution")),
        ("% of points", number("share", ".0f", 100)),
        SPLATS,
        FRAME,
        RMSE,
        ("prototype", number("figure", ".4f")),
        ("ratio", number("ratio", ".2f")),
        ("bar", verdict),
    ]
    return [
        "## Resolutions, against the prototype",
        "",
        *paragraph(f"""Fixed resolutions (`--resolution`) of `moments`, beside {results.prototype['source']}. Bars kept:
            {sum(row.ratio <= row.bar for row in barred)} of {len(barred)}."""),
        *table(columns, rows),
    ]


# All measurements.


def every_frame(results):
    columns = [
        KERNEL,
        ("device", text("device")),
        ("setting", setting),
        SPLATS,
        ("nodes", number("nodes")),
        ("bytes read", number("bytes_read")),
        ("% of the file", lambda row: row.bytes_read and f"{100 * row.bytes_read / row.file_bytes:.1f}"),
        ("first picture ms", number("first_image_s", ".0f", 1e3)),
        FRAME,
        ("cut ms", number("cut_s", ".2f", 1e3)),
        ("sort ms", number("sort_s", ".1f", 1e3)),
        ("draw ms", number("draw_s", ".1f", 1e3)),
        RMSE,
        ("PSNR dB", number("psnr", ".1f")),
        FLIP,
        RIPPLE,
        OUTLINE,
        LIGHT,
    ]
    views = [line for view in results.views for line in (f"### {view}", "", *table(columns, results.of(view=view)))]
    return [
        "## All measurements",
        "",
        *paragraph(
            """RMSE and PSNR are of linear RGB. FLIP is the mean over the sRGB pictures on the background. Light is the
            mean of the picture over that of the exact one. The first picture includes everything from opening the file
            to the finished pixels, and for `svrender --device gl` also starting OpenGL and compiling shaders. VTK has
            the mesh in memory already; its `splats`, and those of `svtruth`, are cells. Frame, cut, sort and draw are
            of steady frames."""
        ),
        *views,
    ]


def equal(results):
    rows = results.of("equal")
    if not rows:
        return []
    pairs = [(plain, by_error) for plain, by_error in zip(rows[::2], rows[1::2])]

    def gain(which):
        ratios = [plain.rmse / by_error.rmse for plain, by_error in pairs if plain[which] is not None]
        return f"{geometric_mean(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"

    offsets = [by_error.expected_error / by_error.rmse for _, by_error in pairs]
    columns = [
        ("view", lambda pair: pair[0].view),
        ("setting", lambda pair: setting(pair[0])),
        ("splats", lambda pair: SPLATS[1](pair[0])),
        ("RMSE", lambda pair: RMSE[1](pair[0])),
        ("by error: splats", lambda pair: SPLATS[1](pair[1])),
        ("RMSE", lambda pair: RMSE[1](pair[1])),
        ("RMSE expected", lambda pair: number("expected_error", ".4f")(pair[1])),
        ("times closer", lambda pair: f"{pair[0].rmse / pair[1].rmse:.2f}"),
    ]
    return [
        "## By expected error, at equal splats",
        "",
        *paragraph(f"""Each tolerance and fixed resolution of `{results.kernel}` beside `--splats` with as many splats,
            a sample for every pixel. RMSE over that by expected error, geometric means (smallest to largest):
            tolerances {gain("tolerance")}, fixed resolutions {gain("resolution")}. The expected error over the true
            one: {geometric_mean(offsets):.2f} ({min(offsets):.2f} to {max(offsets):.2f})."""),
        *table(columns, pairs),
    ]


def sorting(results):
    def cell(sort, say):
        return lambda key: (row := results.all_points(*key, sort=sort)) and say(row)

    columns = [("view", lambda key: key[0]), ("kernel", lambda key: f"`{key[1]}`")]
    for sort in results.plan["sorts"]:
        what = [("sort ms", number("sort_s", ".1f", 1e3)), FRAME, RMSE]
        columns += [(f"{sort}: {title}", cell(sort, say)) for title, say in what]
    return [
        "## Sorting",
        "",
        *paragraph(
            """All points, the camera moving. `none`: back to front by node only. `axis`: by depth along the axis
            nearest to the line of sight, kept while the view turns little. `exact`: every splat by its own depth."""
        ),
        *table(columns, [(view, kernel) for view in results.views for kernel in results.kernels]),
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
            mesh included. `--connectivity` other than mesh leaves the mesh's cells aside: scattered points. Larger
            inputs are in [scale.md](scale.md), and the cost of a view of them in [paging.md](paging.md)."""),
        *table(columns, results.builds),
    ]


def scattered(results):
    rows = results.of("scattered")
    if not rows:
        return []
    figures = results.prototype["scattered"]
    figure = ("prototype", lambda row: figures.get(row.view, {}).get(row.connectivity))
    return [
        "## Scattered points",
        "",
        *paragraph(f"""The same points without the cells (`svbuild --connectivity`), all of them drawn with
            `{results.kernel}`, against the exact picture of the mesh. Without cells nothing tells a hole or a concavity
            from the inside."""),
        *table([VIEW, ("connectivity", text("connectivity")), SPLATS, FRAME, RMSE, FLIP, RIPPLE, LIGHT, figure], rows),
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
    columns = [
        VIEW,
        ("tetrahedra", number("tetrahedra")),
        ("segments a pixel", number("segments_per_pixel")),
        ("seconds", number("seconds", ".2f")),
        ("RMSE", number("rmse", ".2e")),
        ("largest difference", number("max", ".2e")),
    ]
    return [
        "## Reference",
        "",
        *paragraph("""`svtruth` against pictures by an independent program (another algorithm, also in double
            precision)."""),
        *table(columns, results.reference),
    ]


# Pictures and plots.


def picture_names(results):
    """Returns the rows of a view's pictures: from the ending of a file's name to the picture's title."""
    pictures = {"exact": "exact"}
    for kernel in reversed(results.kernels):
        for tolerance in results.plan["pictured_tolerances"]:
            pictures[f"{kernel}-{tolerance:g}"] = f"`{kernel}`, " + (f"{tolerance:g} %" if tolerance else "all points")
    for tolerance in results.plan["pictured_tolerances"]:
        pictures[f"slabs-{tolerance:g}"] = "slabs, " + (f"{tolerance:g} %" if tolerance else "all points")
    differences = {"moments-0-difference": "one by one, difference x 8", "slabs-0-difference": "slabs, difference x 8"}
    lit_names = {f"lit-{kernel}": f"lit, `{kernel}`" for kernel in reversed(results.kernels)}
    return [{**pictures, **PEER_NAMES}, differences, {"lit-exact": "lit, exact", **lit_names}]


def gallery(results, docs):
    """Copies the pictures, and removes those of an earlier page."""
    folder = docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for old in {path for view in results.views for path in folder.glob(f"{view}-*.png")}:
        old.unlink()

    lines = []
    for view in results.views:
        for names in picture_names(results):
            files = {title: results.folder / "pictures" / f"{view}-{ending}.png" for ending, title in names.items()}
            files = {title: path for title, path in files.items() if path.exists()}
            for path in files.values():
                shutil.copy(path, folder)
            if files:
                pictures = [
                    (title, lambda _, path=path: f"![{path.stem}](pictures/{path.name})")
                    for title, path in files.items()
                ]
                lines += table(pictures, [None])
    return ["## Pictures", "", *(lines or ["Not made in this run.", ""])]


def head(results, plotted):
    note, plan = results.note, results.plan
    left_out = sorted({"peers", "flip", "pictures"} - set(note["extras"])) + ([] if plotted else ["plots"])
    with_peers = f"; {note['peers']} with the same OpenGL" if "peers" in note else ""
    renderers = "; ".join(f"{device}: {renderer}" for device, renderer in note["renderers"].items())
    lines = [
        "# Results",
        "",
        *paragraph(f"""Made by `bench/svbench speed --shared SHARED --devices {",".join(plan["devices"])}
            --turns {plan["turns"]}`:
            {note['software']}, {note['cores']} cores of {note['processor']}; {renderers}{with_peers}. Load of the
            machine before the run: {note['load_before']:.2f}."""),
        *paragraph(f"""The settings of a view and the peers took turns ({plan['turns']}, of {plan['frames']} frames
            each), so that other work of the machine hits all alike. A time is the median of the turns' medians
            (fastest-slowest frame). Pictures have the size that their scene says. Frames are steady ones: the data is
            resident and the camera moves. Samples of a picture may be farther apart than pixels; the picture is then
            interpolated (`svrender --sampling`). By default `svrender` does so from a tolerance of 5 % on."""),
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
    for name in plotted:
        lines += [f"![{name}](plots/{name}.png)", ""]
    return lines


def write(results, docs, plotted):
    """Writes results.md and pictures/ in `docs`. `plotted`: names of the plots in plots/."""
    docs.mkdir(parents=True, exist_ok=True)
    lines = head(results, plotted) + by_default(results) + all_beside(results) + slabs(results) + growth(results)
    for kind in PEER_NAMES:
        lines += against_peer(results, kind)
    lines += against_prototype(results) + gallery(results, docs)
    for section in (equal, sorting, building, scattered, lit, reference, every_frame):
        lines += section(results)
    (docs / "results.md").write_text("\n".join(lines).rstrip() + "\n")
