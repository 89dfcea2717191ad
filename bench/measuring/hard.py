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
from .common import Failure, add_programs, words, wrapped
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
        self.vtk = {}  # [mapper]: error; infinite if VTK crashed
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
        self.vtk_version = None  # none: VTK has not drawn a picture
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
                    self.vtk_version = peers.prepare(kind, picture)["version"]
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
`bench/svbench hard` made this page. [accuracy.md](accuracy.md#hard-cases) says what bounds the errors. Each case is a
small mesh and a scene, in perspective and in parallel projection. Figures are root mean square errors of linear RGB
against `svtruth`, the larger of the projections. *Signal* is the error of an empty picture. *Exact* is `svrender
--exact`. Its bound is .002, and larger for some functions. *Splats*, *octant* and *OpenGL* are `--tolerance 0`.
*Octant* is the kernel of the paper. Its bound is .85 of the signal; for functions it has none. A case is *right* within
its bounds. Else it ends with the line shown. **Bold** is neither. Cases in other units are compared with the exact
picture in units of 1.
"""


def page(results, vtk_version):
    lines = ["# Hard cases", "", *wrapped(HEAD)]
    head = f"| case | bound | signal | {' | '.join(WAYS)} | |"
    rule = f"|---|---|---|{'---|' * (len(WAYS) + 1)}"
    for group in dict.fromkeys(result.case.group for result in results):
        lines += ["", f"## {group}", head, rule]
        lines += [result.row() for result in results if result.case.group == group]
    compared = [result for result in results if result.vtk]
    if compared:
        kinds = list(compared[0].vtk)
        lines += ["", "## Beside VTK",
                  f"The same meshes and scenes, drawn by VTK {vtk_version}'s mappers. Ratio: splats to the better of these.",
                  f"| case | splats | {' | '.join(kinds)} | ratio |", f"|---|---|{'---|' * len(kinds)}---|"]
        for result in compared:
            ours = result.errors.get("splats", float("nan"))
            theirs = [vtk_figure(result.vtk[kind]) for kind in kinds]
            ratio = ours / min(result.vtk.values())
            lines.append(f"| {result.case.name} | {ours:.4f} | {' | '.join(theirs)} | {ratio:.2f} |")
    return "\n".join(lines) + "\n"


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
    if not bench.vtk_version and any(result.vtk for result in results):
        raise Failure("VTK draws nothing here, as it says above: without a display, run this by xvfb-run")
    if options.out:
        options.out.write_text(page(results, bench.vtk_version))
    red = [result for result in results if result.red]
    print(f"{len(results)} cases, {len(red)} red")
    for result in red:
        print(f"  {result.case.group}: {result.case.name}: {result.red} {result.refusal}", file=sys.stderr)
    return 1 if red else 0
