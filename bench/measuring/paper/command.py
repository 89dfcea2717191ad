"""Measures methods and claims of Meredith and Ma (2001); makes the tables and pictures of docs/paper.md.

Needs the packages of bench/requirements.txt, except flip-evaluator.
"""

import importlib
import io
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

from ..common import ROOT, Failure, add_programs, add_shared, missing
from .measure import Paper

PAGE = ROOT / "docs/paper.md"
PACKAGES = ("matplotlib", "numpy", "OpenEXR", "PIL", "vtk")
END = "<!-- svbench paper: end -->"

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
    return f"<!-- svbench paper: {part} -->"


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
        raise Failure(f"{PAGE}: no {begin(part)} ... {END}")
    return f"{before}{begin(part)}\n{text}\n{END}{after}"


def add_options(parser):
    add_shared(parser)
    add_programs(parser)
    parser.add_argument(
        "--parts", nargs="+", choices=PARTS, default=list(PARTS), help="default: all, which takes half an hour"
    )
    parser.add_argument("--frames", type=int, default=5, help="frames for each time, which is their median")
    parser.add_argument("--pictures", type=Path, help="folder (default: build/paper; --write: docs/pictures)")
    parser.add_argument("--write", action="store_true", help="put the printed tables in docs/paper.md, part by part")


def run(options):
    if lacking := missing(PACKAGES):
        raise Failure(f"Python package missing: {', '.join(lacking)} (bench/requirements.txt)")
    options.pictures = options.pictures or (ROOT / "docs/pictures" if options.write else ROOT / "build/paper")
    if options.write:
        for part in options.parts:
            put(PAGE.read_text(), part, "")
    with tempfile.TemporaryDirectory(prefix="svbench-") as work:
        paper = Paper(options, Path(work))
        for part in options.parts:
            print(f"\n{begin(part)}")
            text = printed(part, paper)
            print(END, flush=True)
            if options.write:
                PAGE.write_text(put(PAGE.read_text(), part, text))
