"""svbench's command line."""

import argparse
import importlib.util
import os
import sys
import time
from pathlib import Path

from . import plots, report
from .measure import ProgramError, measure, mesh_of
from .peers import PeerError

ROOT = Path(__file__).resolve().parents[2]
PARTS = ["equal", "scattered", "lit", "reference", "growth"]
DEVICES = ["auto", "cpu", "gl"]  # of svrender
EXTRAS = {
    "peers": ["vtk", "numpy", "OpenEXR"],
    "flip": ["flip_evaluator", "numpy", "OpenEXR"],
    "pictures": ["numpy", "OpenEXR", "PIL"],
}
FULL = {
    "tolerances": [0, 0.5, 1, 2, 3, 5, 10, 20, 40],
    "resolutions": 6,
    "samplings": ["auto", "4"],
    "turns": 3,
    "frames": 5,
    "builds": 3,
    "parts": PARTS,
}
# Many points, drawn as so many splats, and then all.
GROWTH = {"source": "gen:points:count=2e7,distribution=vortex,type=float32", "splats": [20000, 200000, 2000000]}
QUICK = {
    "tolerances": [0, 1, 5],
    "resolutions": 1,
    "samplings": ["auto"],
    "turns": 1,
    "frames": 3,
    "builds": 1,
    "parts": [],
}


def words(text):
    if not all(found := text.split(",")):
        raise argparse.ArgumentTypeError(f"'{text}' is no comma-separated list")
    return found


def numbers(text):
    return [float(word) for word in words(text)]


def chosen_from(names):
    def parse(text):
        for word in words(text):
            if word not in names:
                raise argparse.ArgumentTypeError(f"'{word}' is none of {', '.join(names)}")
        return words(text)

    return parse


def count(text):
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no number from 1 up")
    return int(text)


def parser():
    top = argparse.ArgumentParser("svbench", description="Speed against error of splatvol and of VTK's volume mappers.")
    commands = top.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="measure, then report")
    run.add_argument(
        "--programs", type=Path, default=ROOT / "build/release/bin", help="folder of svbuild, svrender, svtruth, svdiff"
    )
    run.add_argument(
        "--shared",
        type=Path,
        required=True,
        help="folder with data/MESH.vtu, scenes/MESH[-WHAT].json, truth/MESH[-WHAT].exr",
    )
    run.add_argument(
        "--quick", action="store_true", help="a minute: one view, few settings, one turn; docs/ stays as it is"
    )
    run.add_argument("--views", type=words, help="comma-separated (default: all scenes; --quick: the first)")
    run.add_argument("--kernels", type=words, default=["octant", "moments"], help="default: octant,moments")
    run.add_argument(
        "--devices",
        type=chosen_from(DEVICES),
        default=["cpu", "gl"],
        help="--device of svrender: the first draws all settings, the others the tolerances (default: cpu,gl)",
    )
    run.add_argument("--tolerances", type=numbers, help="per cent, comma-separated")
    run.add_argument("--sorts", type=words, default=["none", "axis", "exact"], help="default: none,axis,exact")
    run.add_argument("--samplings", type=words, help="--sampling of svrender; always includes auto (default: auto,4)")
    run.add_argument("--turns", type=count, help=f"turns of every setting and peer (default: {FULL['turns']})")
    run.add_argument("--frames", type=count, help=f"frames in a turn (default: {FULL['frames']})")
    run.add_argument(
        "--parts", type=chosen_from(PARTS), help=f"besides the views: {','.join(PARTS)} (default: all; --quick: none)"
    )
    run.add_argument("--without", type=chosen_from(list(EXTRAS)), default=[], help=f"to leave out: {','.join(EXTRAS)}")
    again = commands.add_parser("report", help="report again from the CSV files in OUT")
    for command in (run, again):
        command.add_argument(
            "-o",
            "--out",
            type=Path,
            default=ROOT / "build/bench",
            help="folder of the CSV files (default: build/bench)",
        )
        command.add_argument(
            "--docs", type=Path, help="folder for results.md, plots/ and pictures/ (default: docs; --quick: OUT/docs)"
        )
    return top


def is_there(extra, packages):
    """Returns whether the packages of an extra are installed. Warns if not."""
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        warn(f"no {extra}: Python package missing: {', '.join(missing)} (bench/requirements.txt)")
    return not missing


def plan_of(options):
    """Returns the settings to measure; run.json keeps them."""
    plan = dict(QUICK if options.quick else FULL)
    named = {name: getattr(options, name) for name in ("tolerances", "samplings", "turns", "frames", "parts")}
    plan |= {name: value for name, value in named.items() if value is not None}
    plan["tolerances"] = sorted({0, *plan["tolerances"]})
    plan["samplings"] = list(dict.fromkeys(["auto", *plan["samplings"]]))
    plan["pictured_tolerances"] = [t for t in plan["tolerances"] if t in (0, 1, 5)]
    plan["kernels"], plan["sorts"], plan["devices"] = options.kernels, options.sorts, options.devices
    plan["kernel"] = "moments" if "moments" in options.kernels else options.kernels[-1]
    plan["connectivities"] = ["delaunay", "none"]
    plan["equal_tolerances"] = [1, 2, 3, 5, 8, 12, 20]

    scenes = sorted(path.stem for path in (options.shared / "scenes").glob("*.json"))
    views = plan["views"] = options.views or scenes[: 1 if options.quick else None]
    whole = [view for view in views if view == mesh_of(view)]
    parts = plan.pop("parts")
    plan["equal"] = views if "equal" in parts else []
    plan["scattered"] = whole if "scattered" in parts else []
    plan["lit"] = whole if "lit" in parts else []
    plan["reference"] = views if "reference" in parts else []
    plan["growth"] = GROWTH if "growth" in parts else None
    return plan


def warn(text):
    print(f"svbench: {text}", file=sys.stderr)


def run(options):
    plan = plan_of(options)
    extras = {extra for extra, packages in EXTRAS.items() if extra not in options.without and is_there(extra, packages)}
    if not plan["views"]:
        raise ProgramError(f"{options.shared / 'scenes'}: no scenes")
    if os.getloadavg()[0] > 0.5:
        warn(f"the machine is busy (load {os.getloadavg()[0]:.1f}): times will be longer than they need be")
    start = time.monotonic()
    measure(
        options.programs,
        options.shared,
        options.out,
        plan,
        extras,
        lambda step: print(f"[{time.monotonic() - start:5.0f} s] {step}", flush=True),
    )


def main():
    options = parser().parse_args()
    quick = options.command == "run" and options.quick
    docs = options.docs or (options.out / "docs" if quick else ROOT / "docs")
    try:
        if options.command == "run":
            run(options)
        results = report.Results(options.out)
        plotted = plots.draw(results, docs / "plots") if is_there("plots", ["matplotlib"]) else []
        report.write(results, docs, plotted)
    except (ProgramError, PeerError, OSError) as error:
        warn(error)
        return 1
    print(f"wrote {docs / 'results.md'}")
    return 0
