"""Tools for the parts: builds, pictures, errors, tables."""

import json
import resource

from .. import common

MESHES = ("bluntfin", "post", "wing")
VIEWS = MESHES  # each mesh as a whole, from outside


class Paper:
    """One run. `pictures`: the folder for pictures of the page. `work`: a temporary folder for all other files."""

    def __init__(self, options, work):
        self.programs, self.shared, self.work = options.programs, options.shared, work
        self.frames, self.pictures = options.frames, options.pictures
        self.built = {}

    def attempt(self, program, *arguments):
        """Runs a program. Returns the result of subprocess.run, whatever the exit code."""
        return common.attempt(self.programs / program, *arguments)

    def run(self, program, *arguments):
        return common.output_of(self.programs / program, *arguments)

    def mesh(self, name):
        return self.shared / "data" / f"{name}.vtu"

    def build(self, mesh, *options):
        """Builds once. Returns the file, svbuild's summary, CPU seconds. `mesh`: a shared mesh's name, or a path."""
        if (mesh, *options) not in self.built:
            source = self.mesh(mesh) if isinstance(mesh, str) else mesh
            file = self.work / f"{source.stem}{''.join(options)}.svol"
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            summary = json.loads(self.run("svbuild", source, "-o", file, "--gradients", "--drop-cells", "--json", *options))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            self.built[mesh, *options] = file, summary, seconds
        return self.built[mesh, *options]

    def render(self, file, scene, *options):
        """Draws one splat over the other, as the paper does. Returns the picture and svrender's statistics."""
        picture = self.new_file(".exr")
        usual = ["--scene", scene, "-o", picture, "--stats", "-"]
        return picture, json.loads(self.run("svrender", file, *usual, *options))

    def new_file(self, ending):
        return self.work / f"{len(list(self.work.iterdir()))}{ending}"

    def scene(self, view):
        return self.shared / "scenes" / f"{view}.json"

    def changed_scene(self, view, changes):
        """Writes the view's scene with some fields replaced. Returns its path."""
        path = self.new_file(".json")
        path.write_text(json.dumps(json.loads(self.scene(view).read_text()) | changes))
        return path

    def truth(self, view):
        return self.shared / "truth" / f"{view}.exr"

    def difference(self, a, b):
        """Returns svdiff's report."""
        return json.loads(self.run("svdiff", a, b, "--json"))

    def rmse(self, a, b):
        return self.difference(a, b)["rmse"]

    def error(self, picture, view):
        return self.rmse(picture, self.truth(view))


def paragraph(text):
    """Prints an empty line, then the text in lines of at most 120 characters."""
    print("", *common.wrapped(text), sep="\n")


def table(*names):
    print("", *common.table_head(*names), sep="\n")


def row(*cells):
    print(f"| {' | '.join(str(cell) for cell in cells)} |", flush=True)


def show(path, what):
    """Prints a link to one of the page's pictures."""
    print(f"\n![{what}](pictures/{path.name})")


def milliseconds(stats):
    return f"{1000 * stats['seconds']['frame']:.0f}"
