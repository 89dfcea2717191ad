"""Makes the page of results, its plots and its tables again from the CSV files of `svbench speed`."""

from pathlib import Path

from . import page, plots
from .common import ROOT, missing, warn


def add_options(parser):
    parser.add_argument(
        "-o", "--out", type=Path, default=ROOT / "build/bench", help="folder of the CSV files (default: build/bench)"
    )
    parser.add_argument(
        "--docs", type=Path, help="folder for results.md, plots/ and pictures/ (default: docs; speed --quick: OUT/docs)"
    )


def is_there(extra, packages):
    """Returns whether the packages of an extra are installed. Warns if not."""
    if lacking := missing(packages):
        warn(f"no {extra}: Python package missing: {', '.join(lacking)} (bench/requirements.txt)")
    return not lacking


def run(options):
    docs = options.docs or ROOT / "docs"
    results = page.Results(options.out)
    if plotted := is_there("plots", ["matplotlib"]):
        plots.draw(results, docs / "plots/error-time.png")
    page.write(results, docs, plotted)
    print(f"wrote {docs / 'results.md'}")
