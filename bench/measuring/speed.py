"""Measures speed against error over data sets, kernels and tolerances, with VTK's volume mappers beside.

Writes CSV files, and then the page as `svbench report` does. Needs Python's standard library only. Peers, FLIP,
pictures and plots need the packages of bench/requirements.txt.
"""

import argparse
import os
import time

from . import report
from .common import Failure, add_programs, add_shared, count, warn, words
from .measure import measure, mesh_of

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


def numbers(text):
    return [float(word) for word in words(text)]


def chosen_from(names):
    def parse(text):
        for word in words(text):
            if word not in names:
                raise argparse.ArgumentTypeError(f"'{word}' is none of {', '.join(names)}")
        return words(text)

    return parse


def add_options(parser):
    add_programs(parser)
    add_shared(parser)
    parser.add_argument(
        "--quick", action="store_true", help="a minute: one view, few settings, one turn; docs/ stays as it is"
    )
    parser.add_argument("--views", type=words, help="comma-separated (default: all scenes; --quick: the first)")
    parser.add_argument("--kernels", type=words, default=["octant", "moments"], help="default: octant,moments")
    parser.add_argument(
        "--devices",
        type=chosen_from(DEVICES),
        default=["cpu", "gl"],
        help="--device of svrender: the first draws all settings, the others the tolerances (default: cpu,gl)",
    )
    parser.add_argument("--tolerances", type=numbers, help="per cent, comma-separated")
    parser.add_argument("--sorts", type=words, default=["none", "axis", "exact"], help="default: none,axis,exact")
    parser.add_argument("--samplings", type=words, help="--sampling of svrender; auto is always one (default: auto,4)")
    parser.add_argument("--turns", type=count, help=f"turns of every setting and peer (default: {FULL['turns']})")
    parser.add_argument("--frames", type=count, help=f"frames in a turn (default: {FULL['frames']})")
    parser.add_argument(
        "--parts", type=chosen_from(PARTS), help=f"besides the views: {','.join(PARTS)} (default: all; --quick: none)"
    )
    left_out = f"to leave out: {','.join(EXTRAS)}"
    parser.add_argument("--without", type=chosen_from(list(EXTRAS)), default=[], help=left_out)
    report.add_options(parser)


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


def run(options):
    plan = plan_of(options)
    wanted = {extra: packages for extra, packages in EXTRAS.items() if extra not in options.without}
    extras = {extra for extra, packages in wanted.items() if report.is_there(extra, packages)}
    if not plan["views"]:
        raise Failure(f"{options.shared / 'scenes'}: no scenes")
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
    if options.quick and options.docs is None:
        options.docs = options.out / "docs"
    report.run(options)
