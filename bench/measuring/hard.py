"""Draws hard cases and compares them with exact pictures; writes docs/hard-cases.md.

Every case ends with a picture within its bound, or with one clear line. Needs NumPy; --vtk also needs the packages of
bench/requirements.txt.
"""

import json
import re
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np

from . import hard_cases
from .common import add_programs, words, wrapped
from .hard_cases import REFUSED

SECONDS = 120  # that a program may take; five times as many for a large picture
LEAST_LIGHT = 0.01  # of the exact picture's
WAYS = {
    "exact": ["--exact"],
    "splats": ["--tolerance", "0", "--device", "cpu"],
    "octant": ["--tolerance", "0", "--kernel", "octant", "--device", "cpu"],
    "OpenGL": ["--tolerance", "0", "--device", "gl"],
}


class Refusal(Exception):
    """A program ended with one clear line."""


class Fault(Exception):
    """A program crashed, hung, or failed without a clear line."""


def printed(command, seconds=SECONDS):
    """Returns what a program printed. Raises a Refusal for one line with exit code 1, or about an empty picture; for
    other failures a Fault."""
    name = Path(command[0]).name
    try:
        done = subprocess.run([str(word) for word in command], capture_output=True, timeout=seconds)
    except subprocess.TimeoutExpired as error:
        raise Fault(f"{name} takes more than {seconds} s") from error
    text = done.stderr.decode(errors="replace")
    one_line = len(text.splitlines()) == 1 and text.startswith(f"{name}: ")
    if done.returncode == 0 and not (one_line and " shows nothing: " in text):
        return done.stdout.decode()
    if done.returncode in (0, 1) and one_line:
        raise Refusal(text.strip())
    raise Fault(f"{name} ends with {done.returncode}: {text.strip()[:200]}")


class Measured:
    """What became of a case."""

    def __init__(self, case):
        self.case = case
        self.errors = {}  # [way]: largest of the projections
        self.signal = 0.0  # error of an empty picture
        self.vtk = {}
        self.refusal = ""
        self.fault = ""

    @property
    def red(self):
        """Why the case is not as it should be; empty if it is."""
        if self.fault:
            return self.fault
        if self.case.bound == REFUSED:
            return "" if self.refusal and self.case.says in self.refusal else "not refused for its reason"
        if self.refusal:
            return "refused"
        if self.case.exact and not self.case.bound < self.signal / 2:
            return "an empty picture is as good"
        late = [way for way, error in self.errors.items() if not error <= self.bound_of(way)]
        return f"beyond the bound: {', '.join(late)}" if late else ""

    def bound_of(self, way):
        if not self.case.exact:
            return float("inf")
        if way == "exact":
            return self.case.exact_bound
        if way != "octant":
            return self.case.bound
        return float("inf") if self.case.group == "Functions" else 0.85 * self.signal

    def row(self):
        figures = [figure(way, self.errors[way]) if way in self.errors and self.case.exact else "" for way in WAYS]
        bound = self.case.bound if self.case.bound == REFUSED else f"{self.case.bound:g}" if self.case.exact else "a picture"
        result = f"**{self.red}**" if self.red else self.refusal or "right"
        result = re.sub(r"/\S*/", "", result).replace("|", "\\|")
        if len(result) > 160:
            result = result[:157] + "..."
        signal = f"{self.signal:.3f}" if self.signal else ""
        return f"| {self.case.name} | {bound} | {signal} | {' | '.join(figures)} | {result} |"


class Bench:
    def __init__(self, options, work):
        self.options = options
        self.work = work
        self.ways = {way: arguments for way, arguments in WAYS.items() if way in options.ways}

    def program(self, name):
        return self.options.programs / name

    def difference(self, a, b):
        """Returns the error of picture b, and the mean values of both."""
        result = json.loads(printed([self.program("svdiff"), "--json", a, b]))
        return result["rmse"], *result["mean"]

    def measure(self, case):
        measured = Measured(case)
        try:
            self.draw(case, measured)
        except Refusal as refusal:
            measured.refusal = str(refusal)
        except Fault as fault:
            measured.fault = str(fault)
        return measured

    def draw(self, case, measured):
        made = case.mesh()
        mesh, file = self.work / f"mesh{made.suffix}", self.work / "mesh.svol"
        made.write(mesh)
        file.unlink(missing_ok=True)
        (self.work / "exact.exr").unlink(missing_ok=True)
        printed([self.program("svbuild"), mesh, "-o", file, *case.build])
        for projection in case.projections if case.scene else ("perspective",):
            scene, exact = self.work / "scene.json", self.work / "exact.exr"
            if case.scene:
                scene.write_text(json.dumps(hard_cases.with_projection(case.scene, projection)))
            by_scene = ["--scene", scene] if case.scene else ["--size", "256x256"]
            if case.exact and case.bound != REFUSED:
                self.draw_exact(case, projection, mesh, scene, exact, measured)
            for way, arguments in self.ways.items():
                if not case.has_way(way):
                    continue
                picture = self.work / ("picture.png" if case.large else "picture.exr")
                command = [self.program("svrender"), file, *by_scene, "-o", picture, *arguments]
                try:
                    printed(command, 5 * SECONDS if case.large else SECONDS)
                except Refusal as refusal:
                    if way == "exact" and "it keeps no cells" in str(refusal):
                        continue  # points
                    raise
                if self.options.pictures:
                    name = re.sub(r"\W+", "-", f"{case.group} {case.name} {projection} {way}")[:120]
                    (self.options.pictures / f"{name}{picture.suffix}").write_bytes(picture.read_bytes())
                error = self.error_of(case, picture, exact, way)
                measured.errors[way] = max(measured.errors.get(way, 0.0), error)
            if self.options.vtk and case.vtk:
                self.draw_by_vtk(mesh, scene, exact, measured)

    def error_of(self, case, picture, exact, way):
        """Returns the error of a picture. Raises a Fault if it is dark."""
        if case.large:
            error, exact_light, light = 0.0, 0.0, share_of_light(picture)
        else:
            error, exact_light, light = self.difference(exact if exact.exists() else picture, picture)
        if not light > LEAST_LIGHT * exact_light:
            raise Fault(f"{way}: the picture is dark")
        return error

    def draw_exact(self, case, projection, mesh, scene, exact, measured):
        """Draws the exact picture. Where units do not matter, it is that of the mesh in units of 1."""
        base = next(c for c in hard_cases.units() if c.name == "in units of 1e0") if case.baseline else case
        base_mesh, base_scene = mesh, scene
        if case.truth:
            base_mesh = self.work / "truth.vtu"
            case.truth().write(base_mesh)
        if case.baseline:
            base_mesh, base_scene = self.work / "base.vtu", self.work / "base.json"
            base.mesh().write(base_mesh)
            base_scene.write_text(json.dumps(hard_cases.with_projection(base.scene, projection)))
        printed([self.program("svtruth"), base_mesh, "--scene", base_scene, "-o", exact])
        empty, dark = self.work / "empty.exr", json.loads(base_scene.read_text())
        dark["transfer_function"]["density"] = [[0, 0], [1, 0]]
        (self.work / "dark.json").write_text(json.dumps(dark))
        printed([self.program("svtruth"), base_mesh, "--scene", self.work / "dark.json", "-o", empty])
        signal = self.difference(exact, empty)[0]
        measured.signal = max(measured.signal, signal)
        if signal == 0:
            raise Fault("the exact picture is empty: the case says nothing")

    def draw_by_vtk(self, mesh, scene, exact, measured):
        from .peers import KINDS, PeerError, Peers

        for kind in KINDS:
            with Peers(mesh, scene) as peers:
                picture = self.work / "vtk.exr"
                try:
                    peers.prepare(kind, picture)
                except PeerError:
                    measured.vtk[kind] = float("inf")
                    continue
                measured.vtk[kind] = max(measured.vtk.get(kind, 0.0), self.difference(exact, picture)[0])


def share_of_light(picture):
    """Returns the share of a PNG's bytes that are not 0, in its middle third: rows of nothing are zeros."""
    data, at, packed = picture.read_bytes(), 8, []
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if kind == b"IDAT":
            packed.append(data[at + 8 : at + 8 + length])
        at += length + 12
    pixels = np.frombuffer(zlib.decompress(b"".join(packed)), np.uint8)
    middle = pixels[len(pixels) // 3 : 2 * len(pixels) // 3]
    return np.count_nonzero(middle) / len(middle)


def figure(way, error):
    return f"{error:.0e}" if way == "exact" else f"{error:.4f}"


def vtk_figure(error):
    return "crashes" if error == float("inf") else f"{error:.4f}"


HEAD = """
`bench/svbench hard` made this page. Each case is a small mesh and a scene, in perspective and in parallel projection.
`svrender --exact` draws the cells that the file keeps, and `svrender --tolerance 0` all points. The figures are root mean
square errors of linear RGB against the exact picture (`svtruth`), the larger of the projections. *Signal* is the error
of an empty picture. The bound holds for the kernel `moments`. That of *exact* is .002: the file
rounds positions and values. `octant`, the paper's kernel, knows neither the shape of cells nor the spread
of their values: its error is to be below .85 of the signal, and functions have no bound there. Each bound is below half
of the signal, and each picture has light in it: an empty one would fail. A case is *right* within its bounds. Else it
ends with one line, which the table shows. **Bold** is neither. Cases in other units are compared with the exact picture
in units of 1. `bench/svbench hard --quick` draws a part of them. The tests draw a
sample of this part, and those of the label `long` draw all cases.
"""


def page(results, options):
    lines = ["# Hard cases", "", *wrapped(HEAD)]
    head = f"| case | bound | signal | {' | '.join(WAYS)} | |"
    rule = f"|---|---|---|{'---|' * (len(WAYS) + 1)}"
    for group in dict.fromkeys(result.case.group for result in results):
        lines += ["", f"## {group}", head, rule]
        lines += [result.row() for result in results if result.case.group == group]
    compared = [result for result in results if result.vtk]
    if compared:
        kinds = list(compared[0].vtk)
        lines += ["", "## Beside VTK", "The same meshes and scenes, drawn by VTK's mappers. Ratio: splats to the better of these.",
                  f"| case | splats | {' | '.join(kinds)} | ratio |", f"|---|---|{'---|' * len(kinds)}---|"]
        for result in compared:
            ours = result.errors.get("splats", float("nan"))
            theirs = [vtk_figure(result.vtk[kind]) for kind in kinds]
            ratio = ours / min(result.vtk.values())
            lines.append(f"| {result.case.name} | {ours:.4f} | {' | '.join(theirs)} | {ratio:.2f} |")
    return "\n".join(lines) + "\n" + BOUNDS


# What is known about the errors that are not small.
BOUNDS = """
## What bounds the rest
- **The ball** has 12 cells across, and its surface consists of ellipsoids cut off by planes. Most of its error lies at the
  outline; a finer mesh has less.
- **A vertex of cells far away**: each vertex is one ellipsoid. That of a vertex whose cells are in part needles is as long
  as these, so what it has in the body is lost. Only vertices beside the far one are affected.
- **Opaque matter**: what is seen is one surface, where the opacity rises. Splats know the values in a cell by mean, gradient
  and spread, so the surface is found to within a part of a cell. The spread counts as a normal distribution. If the
  extinction is steep enough, its far end is opaque, too. So a surface seems nearer: by 4 spreads at 1e6 per size, by 6
  to 7 at 1e12, and by at most 9, where the distribution ends. Larger extinctions than 1e20 are drawn as 1e20. If all values are
  opaque, ellipsoids reach over the outline by a part of a cell.
- **Narrow peaks** are thin surfaces in the same sense. The file rounds positions and values, so *exact* finds these
  surfaces to within the rounding: the bound is .01 there.
- **A domain from 0 to 1e-38**: *exact* cuts values off at 1e28 widths of the domain, so where a cell's values cross it is
  found to within the cell.
- **Plates of 1:1e8 and thinner**: *exact* knows their thickness, as depths in a flat chunk of cells count from its plane.
  Single precision has no order of chunks that lie one on the other there. Several such plates in one chunk are an error of
  `--exact`, and splats by default.
- **Ten decades, seen at the lowest**: a cell has values of three times the domain, which its splats spread normally.
- **Plates, dense**: splats are sorted by their centres, and what lies in one plane has no order.
- **0 and 1 at random**: a splat knows a plane and a spread of its own values, and not those of its neighbours.
- **Thin layers round a sphere** differ at the outline, which ellipsoids make a pixel wider.
- **One tetrahedron** is four ellipsoids.
- **1 x 1 pixels**: splats are no narrower than pixels, so the picture is a mean over the pixel, and an exact ray is none.
- **One outlier** changes the picture where its own cells are, as it must, and half a cell farther.
- **Missing values** (NaN) at a tenth of the points take whole cells away. A splat knows the share of its material that has
  a value, and not where.
- **Values below 1e-57 of the largest** are stored as 0: single precision has no room for them. `--missing` takes an
  outlier of such a size away.
- **octant** has a ball for each point, as large as the octree's leaf and with one value. It is not drawn where this shows
  nothing by design: plates, needles, points at one place, peaks that no point's value meets, and 179 degrees.

Splats are meant to have at most half of the error of VTK's better mapper, which cuts colours off at 1 and steps over
functions that are narrow. Where they have not:

| case | why |
|---|---|
| extinction of 1e2 to 1e12 per size | VTK's ray caster samples the cells themselves, and finds an opaque surface exactly while its steps meet the ramp |
| 0 and 1 at random | both of VTK's mappers interpolate in each cell. Splats have a plane and a spread for each point |
| plates of 1:30 and 1:100, and a peak of 1e-02, dense | what lies in one plane has no order of its centres |
| a plate of 1:30, dense | VTK's projected tetrahedra have its exact outline; splats are ellipsoids cut off by planes |
| one tetrahedron, a lattice along its axis | the same: most of the error lies at edges, of which an ellipsoid has one plane |
"""


def add_options(parser):
    add_programs(parser)
    parser.add_argument("--cases", default="", help="regular expression of GROUP: CASE (default: all)")
    parser.add_argument("--quick", action="store_true", help="a part of the cases, without OpenGL")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every N-th of the cases")
    parser.add_argument("--ways", type=words, default=list(WAYS), help=f"default: {','.join(WAYS)}")
    parser.add_argument("--vtk", action="store_true", help="compare narrow and dense functions with VTK's mappers")
    parser.add_argument("--pictures", type=Path, help="keep the pictures in this folder")
    parser.add_argument("-o", "--out", type=Path, help="the page to write, docs/hard-cases.md")


def run(options):
    if options.quick:
        options.ways = [way for way in options.ways if way != "OpenGL"]
    cases = [case for case in hard_cases.all_cases() if case.quick or not options.quick]
    cases = [case for case in cases if re.search(options.cases, f"{case.group}: {case.name}")][:: options.every]
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    results = []
    with tempfile.TemporaryDirectory() as work:
        bench = Bench(options, Path(work))
        for case in cases:
            results.append(bench.measure(case))
            print(f"{case.group}: {results[-1].row()}", flush=True)
    if options.out:
        options.out.write_text(page(results, options))
    red = [result for result in results if result.red]
    print(f"{len(results)} cases, {len(red)} red")
    for result in red:
        print(f"  {result.case.group}: {result.case.name}: {result.red} {result.refusal}", file=sys.stderr)
    return 1 if red else 0
