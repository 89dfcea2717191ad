"""svbench's command line. A subcommand is a module with add_options(parser) and run(options)."""

import argparse
import importlib
import sys

from .common import Failure, warn

# Subcommand: its module and what it does.
COMMANDS = {
    "speed": ("speed", "measures speed against error, with VTK's mappers beside; writes docs/results.md"),
    "report": ("report", "writes docs/results.md again from the CSV files of `svbench speed`"),
    "error": ("error", "measures whether svrender --max-error keeps its word; prints a table for docs/accuracy.md"),
    "hard": ("hard", "compares pictures of hard cases with exact ones; writes docs/hard-cases.md"),
    "estimates": ("estimates", "compares svbuild --estimate with builds; writes that section of docs/scale.md"),
    "scale": ("scale", "builds larger and larger volumes; writes the section Builds of docs/scale.md"),
    "paging": ("paging", "measures the cost of a view of files of different sizes; writes the section Views of docs/scale.md"),
    "look": ("look", "measures how svview keeps up with a hand that turns the data; prints a table for docs/scale.md"),
    "moving": ("moving", "judges what svview shows while a hand moves: error, rate, latency; prints tables"),
    "paper": ("paper.command", "measures claims of Meredith and Ma (2001); makes the tables of docs/paper.md"),
}


def parse(arguments):
    """Returns the options and the subcommand's module. Imports no other module: its packages may be missing."""
    top = argparse.ArgumentParser("svbench", description="Measures splatvol, and writes pages of the docs.")
    commands = top.add_subparsers(dest="command", required=True, metavar="SUBCOMMAND")
    chosen = None
    for name, (module, what) in COMMANDS.items():
        command = commands.add_parser(name, help=what)
        if arguments[:1] == [name]:
            chosen = importlib.import_module(f".{module}", __package__)
            command.description = chosen.__doc__
            command.formatter_class = argparse.RawDescriptionHelpFormatter
            chosen.add_options(command)
    return top.parse_args(arguments), chosen


def main():
    try:
        options, module = parse(sys.argv[1:])
        return module.run(options)
    except ModuleNotFoundError as error:
        warn(f"Python package missing: {error.name} (bench/requirements.txt)")
    except (Failure, OSError) as error:
        warn(error)
    return 1
