#!/usr/bin/env python3
"""Measures what docs/results.md states, and writes it: bench/results.py PROGRAMS SHARED

PROGRAMS: the folder with svbuild, svrender, svtruth, svdiff (build/release/bin). SHARED: a folder with data/*.vtu,
scenes/*.json and truth/*.exr. Needs Python's standard library only. Times are medians of several runs in one go, with
the smallest and the largest beside them."""
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

TOLERANCES = [0, 1, 5, 10, 20]
BUILD_RUNS = 5
FRAMES = 9
VIEWS = {  # scene: mesh
    "bluntfin": "bluntfin", "bluntfin-close": "bluntfin", "bluntfin-ortho": "bluntfin",
    "post": "post", "post-close": "post", "wing": "wing", "wing-wake": "wing",
}
PICTURED = ["bluntfin", "post", "wing"]

programs, shared = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
docs = Path(__file__).resolve().parent.parent / "docs"
pictures = docs / "pictures"
work = Path(tempfile.mkdtemp(prefix="splatvol-results-"))


def run(program, *arguments):
    done = subprocess.run([programs / program, *map(str, arguments)], capture_output=True, text=True, cwd=work)
    if done.returncode != 0:
        sys.exit(f"{program} {' '.join(map(str, arguments))}: {done.stderr.strip()}")
    return done.stdout


def spread(values, unit=1000, digits=1):
    return f"{statistics.median(values) * unit:.{digits}f} ({min(values) * unit:.{digits}f}-{max(values) * unit:.{digits}f})"


def build_table():
    rows = []
    for mesh in dict.fromkeys(VIEWS.values()):
        volume = work / f"{mesh}.svol"
        runs = [json.loads(run("svbuild", shared / "data" / f"{mesh}.vtu", "-o", volume, "--json")) for _ in range(BUILD_RUNS)]
        last = runs[-1]
        counts = ", ".join(str(n) for n in last["resolutions"])
        rows.append(f"| {mesh} | {last['points']} | {counts} | {spread([r['seconds'] for r in runs], 1, 2)} | {last['file_bytes']} | "
                    f"{last['file_bytes'] / last['points']:.1f} | {(shared / 'data' / f'{mesh}.vtu').stat().st_size} |")
    return rows


def view_table(view, mesh):
    rows = []
    volume, scene = work / f"{mesh}.svol", shared / "scenes" / f"{view}.json"
    size = volume.stat().st_size
    for tolerance in TOLERANCES:
        picture = work / "picture.exr"
        stats = json.loads(run("svrender", volume, "--scene", scene, "-o", picture, "--tolerance", tolerance, "--repeat", FRAMES, "--stats", "-"))
        error = json.loads(run("svdiff", shared / "truth" / f"{view}.exr", picture, "--json"))
        seconds = stats["seconds"]
        rows.append(f"| {view} | {tolerance} | {stats['splats']} | {stats['nodes']} | {stats['bytes_read']} | {100 * stats['bytes_read'] / size:.1f} | "
                    f"{stats['first_image_seconds'] * 1000:.0f} | {seconds['frame'] * 1000:.1f} ({seconds['frame_min'] * 1000:.1f}-{seconds['frame_max'] * 1000:.1f}) | {seconds['cut'] * 1000:.2f} | {seconds['draw'] * 1000:.1f} | "
                    f"{error['rmse']:.4f} | {error['mean'][1] / error['mean'][0]:.3f} |")
    return rows


def sort_table():
    rows = []
    for view, mesh in VIEWS.items():
        cells = []
        for sort in ["exact", "none"]:
            picture, scene = work / "picture.exr", shared / "scenes" / f"{view}.json"
            stats = json.loads(run("svrender", work / f"{mesh}.svol", "--scene", scene, "-o", picture, "--tolerance", 0, "--sort", sort,
                                   "--repeat", FRAMES, "--stats", "-"))
            error = json.loads(run("svdiff", shared / "truth" / f"{view}.exr", picture, "--json"))
            cells += [f"{stats['seconds']['sort'] * 1000:.1f}", f"{stats['seconds']['frame'] * 1000:.1f}", f"{error['rmse']:.4f}"]
        rows.append(f"| {view} | " + " | ".join(cells) + " |")
    return rows


def draw_pictures(view, mesh):
    # By short names: pictures tell in their headers what they were made from.
    for path in [shared / "scenes" / f"{view}.json", shared / "data" / f"{mesh}.vtu"]:
        if not (work / path.name).exists():
            (work / path.name).symlink_to(path)
    names = ["truth"] + [str(t) for t in TOLERANCES]
    options = ["--scene", f"{view}.json", "--size", "256x256"]
    run("svtruth", f"{mesh}.vtu", *options, "-o", pictures / f"{view}-truth.png")
    for tolerance in TOLERANCES:
        run("svrender", f"{mesh}.svol", *options, "-o", pictures / f"{view}-{tolerance}.png", "--tolerance", tolerance)
    return "| " + " | ".join(f"![{view}, {name}](pictures/{view}-{name}.png)" for name in names) + " |"


def truth_table():
    rows = []
    for view, mesh in VIEWS.items():
        picture = work / "truth.exr"
        stats = json.loads(run("svtruth", shared / "data" / f"{mesh}.vtu", "--scene", shared / "scenes" / f"{view}.json", "-o", picture, "--json"))
        error = json.loads(run("svdiff", shared / "truth" / f"{view}.exr", picture, "--json"))
        rows.append(f"| {view} | {stats['tetrahedra']} | {stats['segments_per_pixel']:.0f} | {stats['seconds']:.2f} | {error['rmse']:.2e} | {error['max']:.2e} |")
    return rows


def processor():
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def main():
    pictures.mkdir(parents=True, exist_ok=True)
    report = [
        "# Results", "",
        f"Made by `bench/results.py build/release/bin SHARED` on {os.cpu_count()} cores of {processor()}, software OpenGL (Mesa llvmpipe). SHARED holds the meshes, "
        "scenes and exact pictures; pictures of the comparison are 512 x 512. Times are medians (smallest-largest) of runs in one go.", "",
        "## Building", "", f"`svbuild MESH.vtu -o MESH.svol --json`, {BUILD_RUNS} runs; reading the mesh is included.", "",
        "| mesh | points | resolutions | seconds | bytes of the .svol | bytes a point | bytes of the .vtu |", "|---|---|---|---|---|---|---|",
        *build_table(), "",
        "## Drawing: time, bytes and error", "",
        f"`svrender MESH.svol --scene SCENE.json -o OUT.exr --tolerance PERCENT --repeat {FRAMES} --stats -` and `svdiff TRUTH.exr OUT.exr --json`. RMSE is of linear RGB; light is the mean "
        "of the picture over that of the truth. The first picture includes everything from opening the files to the finished pixels, also making the OpenGL context and compiling shaders; a frame is one with the data resident.", "",
        "| view | tolerance % | splats | nodes | bytes read | % of the file | first picture ms | frame ms | cut ms | draw ms | RMSE | light |", "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for view, mesh in VIEWS.items():
        report += view_table(view, mesh)
    report += ["", "The `octant` kernel knows nothing of cell shapes; its error does not vanish at tolerance 0. That is the paper's method, and the base line for the next kernel.", "",
               "## Sorting", "", "At tolerance 0, medians: every splat in its place (`--sort exact`), or back to front by node only (`--sort none`).", "",
               "| view | exact: sort ms | frame ms | RMSE | none: sort ms | frame ms | RMSE |", "|---|---|---|---|---|---|---|", *sort_table(), "",
               "## Pictures", "", "From the left: the exact picture (`svtruth`), then tolerance 0 (all points), 1, 5, 10 and 20 %.", ""]
    for view in PICTURED:
        report += ["| truth | 0 % | 1 % | 5 % | 10 % | 20 % |", "|---|---|---|---|---|---|", draw_pictures(view, VIEWS[view]), ""]
    report += ["## Reference", "", "`svtruth MESH.vtu --scene SCENE.json -o OUT.exr --json` against pictures made by an independent program (another algorithm, "
               "also in double precision).", "", "| view | tetrahedra | segments a pixel | seconds | RMSE | largest difference |", "|---|---|---|---|---|---|", *truth_table(), ""]
    (docs / "results.md").write_text("\n".join(report))
    print(f"wrote {docs / 'results.md'}")


main()
