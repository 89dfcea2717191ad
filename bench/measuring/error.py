"""Measures whether svrender --max-error keeps its word; prints a table for docs/accuracy.md.

Compares pictures of --max-error with exact ones, and on request their splats with the fewest that --splats needs for
the same error. Needs Python's standard library only.
"""

import json
import math
import re
import tempfile
from pathlib import Path

from .common import add_programs, output_of, table_head

FIRST, STEP = 256, math.sqrt(2)  # splats of the sweep


class View:
    """A file, a scene and the exact picture."""

    def __init__(self, programs, work, file, scene, truth):
        self.programs, self.work, self.file, self.scene, self.truth = programs, work, file, scene, truth
        self.curve = []  # (splats, error, cut seconds), fewer splats first
        self.is_complete = False

    def draw(self, *detail):
        """Draws a picture. Returns its statistics and its error."""
        picture = Path(self.work) / "picture.exr"
        options = [self.file, "--scene", self.scene, "-o", picture, "--stats", "-"]
        stats = json.loads(output_of(self.programs / "svrender", *options, *detail))
        return stats, self.error_of(picture)

    def error_of(self, picture):
        return float(re.search(r"rmse (\S+)", output_of(self.programs / "svdiff", self.truth, picture)).group(1))

    def extend(self):
        """Adds a point to the sweep over splats. Returns whether there was one to add."""
        if self.is_complete:
            return False
        asked = FIRST * STEP ** len(self.curve)
        stats, error = self.draw("--splats", int(asked))
        self.is_complete = stats["splats"] < asked / 9  # the next finer cut has no more than 8 times the splats
        self.curve.append((stats["splats"], error, stats["seconds"]["cut"]))
        return True

    def fewest(self, wanted):
        """Returns the fewest splats of an error, interpolated in the sweep; None if even all points have more."""
        i = 0
        while i < len(self.curve) or self.extend():
            splats, error, _ = self.curve[i]
            if error <= wanted:
                if i == 0 or self.curve[i - 1][1] <= error:
                    return splats
                before, before_error, _ = self.curve[i - 1]
                share = math.log(before_error / wanted) / math.log(before_error / max(error, 1e-12))
                return before * (splats / before) ** share
            i += 1
        return None


def view_of(programs, work, names):
    """Returns a view; that of a mesh has a scene that fits the data."""
    if "," in names:
        return View(programs, work, *names.split(","))
    made = Path(work) / Path(names).stem
    file, scene, truth = (made.with_suffix(suffix) for suffix in (".svol", ".json", ".exr"))
    output_of(programs / "svbuild", names, "-o", file)
    output_of(programs / "svinfo", file, "--scene", scene)
    output_of(programs / "svtruth", names, "--scene", scene, "--size", "512x512", "-o", truth)
    document = json.loads(scene.read_text())
    document["image"] = {"width": 512, "height": 512}
    scene.write_text(json.dumps(document))
    return View(programs, work, file, scene, truth)


def add_options(parser):
    parser.add_argument("views", nargs="+", help="FILE.svol,SCENE.json,EXACT.exr, or a mesh")
    add_programs(parser)
    parser.add_argument("--fewest", action="store_true", help="compares with the fewest splats of an error; takes long")
    parser.add_argument("--errors", nargs="+", type=float, default=[0.02, 0.01, 0.005, 0.0025])


def run(options):
    titles = ["view", "wanted", "error", "of the wanted", "estimated", "drawn", "samples", "of the fewest", "pictures"]
    print("\n".join(table_head(*titles, "ms to find", "ms of a frame")))
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        for names in options.views:
            view = view_of(options.programs, work, names)
            for wanted in options.errors:
                stats, error = view.draw("--max-error", wanted)
                of_fewest = "-"
                if options.fewest and not stats.get("exact"):
                    fewest = view.fewest(wanted)
                    of_fewest = f"{stats['splats'] / fewest:.2f}" if fewest else "not in reach"
                print(
                    f"| {Path(view.scene).stem} | {wanted:g} | {error:.5f} | {error / wanted:.2f} "
                    f"| {stats['estimated_error']:.5f} | {'cells' if stats.get('exact') else stats['splats']} "
                    f"| {stats['sample_spacing']} | {of_fewest} "
                    f"| {stats.get('pictures_for_error', 1)} | {1000 * stats['first_image_seconds']:.0f} "
                    f"| {1000 * stats['seconds']['frame']:.0f} |",
                    flush=True,
                )
