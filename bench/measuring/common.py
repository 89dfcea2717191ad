"""What subcommands share: options, runs of programs, tables."""

import argparse
import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Failure(Exception):
    """svbench cannot go on. The text says why. If a program failed, it holds the command and its message."""


# Options.


def add_programs(parser):
    what = "folder of the programs (default: build/release/bin)"
    parser.add_argument("--programs", type=Path, default=ROOT / "build/release/bin", help=what)


def add_shared(parser):
    what = "folder with data/MESH.vtu, scenes/VIEW.json and truth/VIEW.exr; VIEW is MESH or MESH-WHAT"
    parser.add_argument("--shared", type=Path, required=True, help=what)


def words(text):
    if not all(found := text.split(",")):
        raise argparse.ArgumentTypeError(f"'{text}' is no comma-separated list")
    return found


def count(text):
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no number from 1 up")
    return int(text)


# Messages.


def warn(text):
    print(f"svbench: {text}", file=sys.stderr)


def missing(packages):
    return [package for package in packages if importlib.util.find_spec(package) is None]


# Programs.


def attempt(*command):
    """Runs a program. Returns the result of subprocess.run, whatever the exit code."""
    command = list(map(str, command))
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise Failure(f"{command[0]}: {error.strerror}") from error


def output_of(*command):
    """Returns what a program printed. Raises a Failure if it fails."""
    done = attempt(*command)
    if done.returncode != 0:
        raise Failure(f"{' '.join(done.args)}: {done.stderr.strip() or f'exit {done.returncode}'}")
    return done.stdout


def measured(*command):
    """Returns what a program printed, with wall and CPU seconds and the peak bytes of its memory."""
    command = list(map(str, command))
    start = time.monotonic()
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process:
            output = process.stdout.read()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            errors.seek(0)
            raise Failure(f"{' '.join(command)}: {errors.read().strip() or f'exit {process.returncode}'}")
    took = {"wall": time.monotonic() - start, "cpu": usage.ru_utime + usage.ru_stime, "peak": usage.ru_maxrss * 1024}
    return output, took


def forget(path):
    """Drops a file from the system's cache."""
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)


def processor():
    info = Path("/proc/cpuinfo")
    for line in info.read_text().splitlines() if info.exists() else []:
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


# Pages.


def wrapped(text):
    """Returns a paragraph in lines of at most 120 characters."""
    return textwrap.wrap(" ".join(text.split()), 120, break_long_words=False, break_on_hyphens=False)


def table_head(*titles):
    """Returns the two lines that begin a Markdown table."""
    return [f"| {' | '.join(titles)} |", "|" + "---|" * len(titles)]


def write_section(page, title, lines):
    """Replaces the section `title` of a page, or adds it at the end. People write the other sections: they stay."""
    before, heading, old = ("\n" + (page.read_text() if page.exists() else "")).partition(f"\n## {title}\n")
    rest = old.partition("\n\n## ") if heading else ("", "", "")
    section = f"\n## {title}\n" + "\n".join(lines)
    page.write_text((before + section + (rest[1] + rest[2] if rest[1] else "\n")).lstrip("\n"))
