"""svpaper's command line."""

import argparse
import importlib.util
import io
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

from .measure import Paper, ProgramError

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/paper.md"
PACKAGES = ("matplotlib", "numpy", "OpenEXR", "PIL", "vtk")
END = "<!-- svpaper: end -->"

# Part: module and function. The function takes a Paper, prints Markdown and writes pictures. A module is imported only
# when its part is made, since it needs packages.
PARTS = {
    "reductions": ("reductions", "reductions"),
    "leaf": ("reductions", "leaf"),
    "tolerances": ("views", "tolerances"),
    "small": ("views", "small"),
    "sorting": ("views", "sorting"),
    "gradients": ("gradient", "gradients"),
    "lighting": ("gradient", "lighting"),
    "large": ("large", "large"),
    "bytes": ("large", "bytes_read"),
}


class Both(io.StringIO):
    """Keeps the text written to it, and also shows it at once."""

    def write(self, text):
        sys.__stdout__.write(text)
        sys.__stdout__.flush()
        return super().write(text)


def begin(part):
    return f"<!-- svpaper: {part} -->"


def printed(part, paper):
    """Makes a part. Returns its printed text without the empty lines round it."""
    module, function = PARTS[part]
    make = getattr(importlib.import_module(f"{__package__}.{module}"), function)
    with redirect_stdout(Both()) as text:
        make(paper)
    return text.getvalue().strip("\n")


def put(page, part, text):
    """Returns the page with `text` between the part's markers. Fails if they are missing."""
    before, found, rest = page.partition(begin(part))
    _, ended, after = rest.partition(END)
    if not found or not ended:
        raise ValueError(f"{PAGE}: no {begin(part)} ... {END}")
    return f"{before}{begin(part)}\n{text}\n{END}{after}"


def parser():
    result = argparse.ArgumentParser("svpaper", description="Methods and claims of Meredith and Ma (2001), measured.")
    result.add_argument(
        "--shared", type=Path, required=True, help="folder with data/MESH.vtu, scenes/VIEW.json, truth/VIEW.exr"
    )
    result.add_argument(
        "--programs",
        type=Path,
        default=ROOT / "build/release/bin",
        help="folder of svbuild, svrender, svdiff, svtruth, svexport",
    )
    result.add_argument(
        "--parts", nargs="+", choices=PARTS, default=list(PARTS), help="default: all, which takes half an hour"
    )
    result.add_argument("--frames", type=int, default=5, help="frames for each time, which is their median")
    result.add_argument("--pictures", type=Path, help="folder (default: build/paper; --write: docs/pictures)")
    result.add_argument("--write", action="store_true", help="put the printed tables in docs/paper.md, part by part")
    return result


def run(options):
    options.pictures = options.pictures or (ROOT / "docs/pictures" if options.write else ROOT / "build/paper")
    if options.write:
        for part in options.parts:
            put(PAGE.read_text(), part, "")
    with tempfile.TemporaryDirectory(prefix="svpaper-") as work:
        paper = Paper(options, Path(work))
        for part in options.parts:
            print(f"\n{begin(part)}")
            text = printed(part, paper)
            print(END, flush=True)
            if options.write:
                PAGE.write_text(put(PAGE.read_text(), part, text))


def main():
    options = parser().parse_args()
    missing = [package for package in PACKAGES if importlib.util.find_spec(package) is None]
    if missing:
        print(f"svpaper: Python package missing: {', '.join(missing)} (bench/requirements.txt)", file=sys.stderr)
        return 1
    try:
        run(options)
    except (ProgramError, OSError, ValueError) as error:
        print(f"svpaper: {error}", file=sys.stderr)
        return 1
    return 0
