"""The options of a program as a page, from what the program prints with --help."""

import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

PROGRAMS = ("svbuild", "svrender", "svview", "svinfo", "svexport", "svserve", "svtruth", "svdiff", "svgen")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


@dataclass
class Help:
    usage: str = ""
    sections: list = field(default_factory=list)  # (title, [(name, words)])
    subcommands: dict = field(default_factory=dict)  # name: Help

    @property
    def options(self) -> set:
        """All options of the program and its subcommands. A line of `svserve` names them in its usage, too."""
        text = " ".join([self.usage] + [name for _, entries in self.sections for name, _ in entries])
        found = set(OPTION.findall(text)) | {"--help"}
        return found.union(*(inner.options for inner in self.subcommands.values()))

    @staticmethod
    def of(program: Path, *arguments: str) -> "Help":
        try:
            done = subprocess.run([program, *arguments, "--help"], capture_output=True, text=True, timeout=60)
        except OSError as error:
            sys.exit(f"docs: {program} does not run: {error.strerror}")
        if done.returncode != 0 or not done.stdout:
            sys.exit(f"{program} --help: {done.stderr.strip() or 'prints nothing'}")
        found = parse(done.stdout.replace(str(program), program.name), program.name)
        for title, entries in found.sections:
            if title == "Subcommands":
                found.subcommands = {name: Help.of(program, *arguments, name) for name, _ in entries}
        return found


def parse(text: str, program: str) -> Help:
    """Reads sections of entries: a name after two spaces, then its words, on the same line or indented more.

    Fails if it meets any other line, so that nothing is left out.
    """
    found = Help()
    for line in text.splitlines():
        entry = re.match(r"  (\S.*?)(?:  +(\S.*))?$", line)
        if line.startswith("Usage: "):
            found.usage = line.removeprefix("Usage: ")
        elif not line or (not found.usage and not line.startswith(" ")):
            continue  # the description, which the page has in its own words
        elif re.fullmatch(r"[A-Z][\w ]+:", line):
            found.sections.append((line[:-1], []))
        elif entry:
            if not found.sections:
                found.sections.append(("Options", []))
            found.sections[-1][1].append((entry[1], entry[2] or ""))
        elif line.startswith("   ") and found.sections and found.sections[-1][1]:
            name, words = found.sections[-1][1][-1]
            found.sections[-1][1][-1] = (name, f"{words} {line.strip()}".strip())
        else:
            sys.exit(f"{program} --help: a line that docs/site/program_pages.py does not understand: {line}")
    if not found.usage or not found.sections:
        sys.exit(f"{program} --help: no usage, or no options")
    return found


def entry_lines(prefix: str, name: str, words: str) -> list:
    """A definition, with an anchor if it is an option: #--memory."""
    option = OPTION.search(name)
    anchor = f"{{ #{prefix}{option[0]} }}" if option else ""
    words = re.sub(r"(?<![\w`-])--[a-z][a-z-]*", r"`\g<0>`", words or "(no words)").replace("<", "&lt;")
    return [f"`{name}`{anchor}", f":   {words}", ""]


def lines_of(help_text: Help, level: int, prefix: str) -> list:
    lines = ["```text", help_text.usage, "```", ""]
    for title, entries in help_text.sections:
        lines += [f"{'#' * level} {title}", ""]
        for name, words in entries:
            lines += entry_lines(prefix, name, words)
    for name, inner in help_text.subcommands.items():
        lines += [f"{'#' * level} {name}", ""] + lines_of(inner, level + 1, f"{name}-")
    return lines


def complete(text: str, help_text: Help) -> str:
    """Appends the options to the page that was written by hand."""
    return text.rstrip("\n") + "\n\n## Usage\n" + "\n".join(lines_of(help_text, 2, "")) + "\n"


def commands(text: str):
    """The commands in code that begins with a program's name: its name and its options."""
    code = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    parts = [line for block in code for line in block.replace("\\\n", " ").splitlines()]
    parts += [part.replace("\n", " ") for part in re.findall(r"(?<!`)`([^`]+)`(?!`)", re.sub(r"```.*?```", "", text, flags=re.DOTALL))]
    for part in parts:
        for command in re.split(r"[;|&]|#.*", part):
            words = command.split()
            if words and Path(words[0]).name in PROGRAMS:
                yield Path(words[0]).name, set(OPTION.findall(command))
