#!/usr/bin/env python3
"""Gathers the pages of the site: stage.py PROGRAMS PAGES, from the root of the repository.

The folder PAGES mirrors the repository, so that links between files work in both. Three things differ:
- docs/index.md becomes the first page, and README.md the page overview.md.
- docs/programs/NAME.md gets the options of `NAME --help`, from the folder PROGRAMS.
- docs/api.md gets the declarations of include/splatvol/.

Files that pages link to are there as well: pictures, scripts, sources. Fails if a program lacks an option that a page
calls it with.
"""

import re
import shutil
import sys
from pathlib import Path, PurePosixPath

sys.path.insert(0, str(Path(__file__).parent))
import api_pages
import program_pages

ROOT_PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "spec/svol-1.md")
MOVED = {"README.md": "overview.md", "docs/index.md": "index.md"}
LINK = re.compile(r"(?<=\]\()(?!https?:|mailto:|#)([^)#\s]+)")
LIST_ITEM = re.compile(r" *([-*]|\d+\.) ")


def resolve(page: str, link: str) -> str:
    """Returns the path in the repository of a link of a page; it may lead out of the repository."""
    parts = []
    for part in (PurePosixPath(page).parent / link).parts:
        if part == ".." and parts and parts[-1] != "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join(parts)


def relative(page: str, target: str) -> str:
    """Returns the link from a page to a file, both by their paths in PAGES."""
    here, there = PurePosixPath(page).parent.parts, PurePosixPath(target).parts
    common = 0
    while common < min(len(here), len(there) - 1) and here[common] == there[common]:
        common += 1
    return "/".join([".."] * (len(here) - common) + list(there[common:]))


def outside_code(text: str, change) -> str:
    """Changes the lines that are no code, by change(line, line before)."""
    lines, code, before = [], False, ""
    for line in text.split("\n"):
        fence = line.lstrip().startswith("```")
        lines += [line] if code or fence else change(line, before)
        code ^= fence
        before = line
    return "\n".join(lines)


def separate_blocks(line: str, before: str) -> list:
    """Sets lists and tables off from the paragraph above. The repository's view needs no empty line there, MkDocs does."""
    is_text = before.strip() and not before.startswith((" ", "#", "|", "```")) and not LIST_ITEM.match(before)
    return ["", line] if is_text and (LIST_ITEM.match(line) or line.startswith("|")) else [line]


def nest_lists(line: str, _before: str) -> list:
    """Lists in lists are indented by three columns at most in the repository, and by four for MkDocs."""
    return [re.sub(r"^ {2,3}(?=[-*] )", "    ", line)]


class Stage:
    def __init__(self, programs: Path, pages: Path):
        self.programs, self.pages = programs, pages
        self.helps = {}
        self.staged = set()

    def add(self, page: str) -> None:
        """Stages a page, and all files that it links to."""
        if page in self.staged:
            return
        self.staged.add(page)
        text = Path(page).read_text()
        if page.startswith("docs/programs/") and not page.endswith("index.md"):
            text = program_pages.complete(text, self.help_of(Path(page).stem))
        elif page == "docs/api.md":
            text = api_pages.complete(text, Path("include/splatvol"))
        if page != "CHANGELOG.md":  # which names options that are no more
            self.check_commands(page, text)
        text = outside_code(text, separate_blocks)
        text = outside_code(text, nest_lists)
        place = MOVED.get(page, page)
        links = set()

        def replace(match) -> str:
            target = resolve(page, match[1])
            links.add(target)
            return relative(place, MOVED.get(target, target))

        text = outside_code(text, lambda line, _: [LINK.sub(replace, line)])
        self.write(place, text)
        for target in sorted(links):
            if target.endswith(".md") and Path(target).is_file():
                self.add(target)
            elif Path(target).is_file() and target not in self.staged:
                self.staged.add(target)
                self.copy(target)

    def write(self, place: str, text: str) -> None:
        path = self.pages / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def copy(self, target: str) -> None:
        path = self.pages / target
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(target, path)

    def help_of(self, program: str) -> program_pages.Help:
        if program not in self.helps:
            self.helps[program] = program_pages.Help.of(self.programs / program)
        return self.helps[program]

    def check_commands(self, page: str, text: str) -> None:
        """Fails if a command of a page has an option that its program lacks."""
        for program, options in program_pages.commands(text):
            for option in sorted(options - self.help_of(program).options):
                sys.exit(f"{page}: {program} has no option {option}")


def main() -> None:
    programs, pages = Path(sys.argv[1]), Path(sys.argv[2])
    shutil.rmtree(pages, ignore_errors=True)
    stage = Stage(programs, pages)
    for page in ROOT_PAGES:
        stage.add(page)
    for page in sorted(Path("docs").glob("*.md")) + sorted(Path("docs/programs").glob("*.md")):
        stage.add(str(page))


if __name__ == "__main__":
    main()
