"""Meshes are converted when they are opened: by svbuild, or read by PyVista."""

import json
import os
import shutil
import signal
import stat
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import splatvol
from conftest import ball, linear
from splatvol import _conversions


def write_mesh(path, shift=0.0):
    """Writes a ball as a legacy file of VTK, with T = linear(p) + shift and the vector U = 2 p."""
    points, cells = ball(4)

    def lines(rows):
        return "".join(" ".join(str(number) for number in row) + "\n" for row in rows)

    path.write_text(
        f"# vtk DataFile Version 3.0\nball\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {len(points)} double\n"
        f"{lines(points)}CELLS {len(cells)} {5 * len(cells)}\n{lines([4, *cell] for cell in cells)}"
        f"CELL_TYPES {len(cells)}\n{lines([10] for _ in cells)}POINT_DATA {len(points)}\n"
        f"SCALARS T double 1\nLOOKUP_TABLE default\n{lines([value + shift] for value in linear(points))}"
        f"VECTORS U double\n{lines(2 * points)}"
    )
    return path


def write_series(folder):
    """Writes two steps of it, at 0 and 1.5, as ParaView lists files."""
    files = [{"name": write_mesh(folder / f"m{i}.vtk", i).name, "time": 1.5 * i} for i in range(2)]
    path = folder / "m.vtk.series"
    path.write_text(json.dumps({"file-series-version": "1.0", "files": files}))
    return path


@pytest.fixture()
def mesh_path(tmp_path):
    return write_mesh(tmp_path / "mesh.vtk")


@pytest.fixture()
def fake(tmp_path, monkeypatch):
    """Puts a script in the place of svbuild. It runs in the folder of its notes."""
    folder = tmp_path / "fake"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")

    def write(script):
        program = folder / "svbuild"
        program.write_text(f'#!/bin/sh\ncd {folder}\necho "$@" > arguments\n{script}')
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        return folder

    return write


def say(line):
    return f"echo '{json.dumps(line)}'\n"


def result(path, temporary=False, notes=()):
    told = {"file": str(path), "built": True, "temporary": temporary, "seconds": 1, "notes": list(notes)}
    return say({"result": told})


def wait_for(path):
    limit = time.monotonic() + 30
    while not path.exists():
        assert time.monotonic() < limit, f"{path} does not appear"
        time.sleep(.01)


def test_svbuild_converts(mesh_path, ball_path, fake):
    folder = fake(
        say({"stage": "read", "share": .25, "seconds_left": None})
        + say({"stage": "sort", "share": .5, "seconds_left": 2})
        + result(ball_path, notes=["a note", "another"]) + "cat\ntouch ended\n"
    )
    told = []
    with pytest.warns(UserWarning) as warned:
        file = splatvol.open(mesh_path, progress=lambda stage, share: told.append((stage, share)))
    assert [str(one.message) for one in warned] == ["a note", "another"] and warned[0].filename == __file__
    assert told == [("read", .25), ("sort", .5)]
    assert (folder / "arguments").read_text().split() == ["--cached", "--progress", "--", str(mesh_path)]
    # The file is svbuild's; its name is that of the mesh.
    assert file.path == str(ball_path) and file.name == str(mesh_path) and "mesh.vtk" in repr(file)
    np.testing.assert_array_equal(file.render(size=(20, 20)), splatvol.open(ball_path).render(size=(20, 20)))
    assert (folder / "ended").exists()


def test_what_svbuild_is_asked_for(tmp_path, mesh_path, series_path, fake):
    folder = fake(result(series_path) + "cat\n")

    def asked():
        return (folder / "arguments").read_text().split()[2:]

    second = write_mesh(tmp_path / "second.vtk")
    splatvol.open([mesh_path, second])
    assert asked() == ["--", str(mesh_path), str(second)]
    pieces = tmp_path / "pieces"
    pieces.mkdir()
    shutil.copy(mesh_path, pieces)
    splatvol.open(str(pieces))
    assert asked() == ["--", str(pieces)]
    assert splatvol.open(mesh_path, step=0).step == 0
    assert asked() == ["--times", "all", "--", str(mesh_path)]
    assert splatvol.open([mesh_path], time=.9).time == 1
    assert asked() == ["--times", "all", "--", str(mesh_path)]
    with pytest.raises(splatvol.InvalidArgumentError, match="no step 7"):
        splatvol.open(mesh_path, step=7)
    with pytest.raises(splatvol.InvalidArgumentError, match="no path"):
        splatvol.open([])


def test_a_temporary_file_goes_with_the_file(mesh_path, ball_path, tmp_path, fake):
    temporary = tmp_path / "temporary.svol"
    copy = f"cp {ball_path} {temporary}\n" + result(temporary, temporary=True)
    # The end of its input or an interruption ends svbuild; it removes the file in both cases.
    folder = fake(copy + f"end() {{\nrm {temporary}\ntouch ended\nexit\n}}\ntrap end INT\ncat\nend\n")
    file = splatvol.open(mesh_path)
    assert temporary.exists() and not (folder / "ended").exists()
    viewed = file.points()
    file.close()
    assert (folder / "ended").exists() and not temporary.exists()
    (folder / "ended").unlink()
    np.testing.assert_allclose(viewed.values["T"], linear(viewed.positions), rtol=1e-5)
    file = splatvol.open(mesh_path)
    assert temporary.exists()
    del file
    assert (folder / "ended").exists() and not temporary.exists()


def test_a_window_keeps_a_temporary_file(mesh_path, ball_path, tmp_path, fake):
    temporary = tmp_path / "temporary.svol"
    copy = f"cp {ball_path} {temporary}\n" + result(temporary, temporary=True)
    folder = fake(copy + f"end() {{\nrm {temporary}\nexit\n}}\ntrap end INT\ncat\nend\n")
    svview = folder / "svview"
    script = 'mkfifo go\ntouch started\nread word < go\n[ -e "$1" ] && touch was_there\n'
    svview.write_text(f"#!/bin/sh\ncd {folder}\n{script}")
    svview.chmod(svview.stat().st_mode | stat.S_IXUSR)
    process = splatvol.show(splatvol.open(mesh_path))
    wait_for(folder / "started")
    (folder / "go").write_text("go\n")
    assert process.wait() == 0 and (folder / "was_there").exists()


def test_errors_of_svbuild(mesh_path, tmp_path, fake):
    fake(say({"error": "mesh.vtk: no volume cells"}) + "exit 1\n")
    with pytest.raises(splatvol.InvalidDataError, match="^mesh.vtk: no volume cells$"):
        splatvol.open(mesh_path)
    fake("exit 3\n")
    with pytest.raises(splatvol.FileError, match="exit code 3"):
        splatvol.open(mesh_path)
    fake(result(tmp_path / "absent.svol") + "cat\n")
    with pytest.raises(splatvol.MissingFileError, match="absent.svol"):
        splatvol.open(mesh_path)
    with pytest.raises(FileNotFoundError, match="absent.vtu: No such file"):
        splatvol.open(tmp_path / "absent.vtu")
    with pytest.raises(FileNotFoundError, match="absent.vtu: No such file"):
        splatvol.open([mesh_path, tmp_path / "absent.vtu"])


def test_ctrl_c_ends_a_conversion(mesh_path, fake):
    folder = fake(
        "trap 'touch interrupted; exit 1' INT\n" + say({"stage": "read", "share": 0, "seconds_left": None})
        + "while read word; do :; done\n"
    )
    with pytest.raises(KeyboardInterrupt):
        splatvol.open(mesh_path, progress=lambda *_: os.kill(os.getpid(), signal.SIGINT))
    assert (folder / "interrupted").exists()


def test_what_progress_raises_ends_a_conversion(mesh_path, fake):
    folder = fake(
        "trap 'touch interrupted; exit 1' INT\n" + say({"stage": "read", "share": 0, "seconds_left": None})
        + "while read word; do :; done\n"
    )
    with pytest.raises(ZeroDivisionError):
        splatvol.open(mesh_path, progress=lambda *_: 1 / 0)
    assert (folder / "interrupted").exists()


@pytest.fixture()
def without_svbuild(monkeypatch, tmp_path):
    """Temporary files are in a folder of their own."""
    monkeypatch.setattr(_conversions, "_find_svbuild", lambda: None)
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_neither_svbuild_nor_pyvista(mesh_path, without_svbuild, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(splatvol.UnsupportedError, match="svbuild in PATH.*pip install pyvista"):
        splatvol.open(mesh_path)


def test_pyvista_reads(mesh_path, without_svbuild):
    pytest.importorskip("pyvista")
    told = []
    file = splatvol.open(mesh_path, progress=lambda stage, share: told.append(share))
    assert told and [a.name for a in file.attributes] == ["T", "U", "U[0]", "U[1]", "U[2]"]
    grid = file.cells()
    np.testing.assert_allclose(grid.point_data["U"], 2 * grid.points, atol=.01)
    assert file.render(size=(20, 20)).any() and Path(file.path).is_relative_to(without_svbuild)
    file.close()
    assert list(without_svbuild.iterdir()) == []
    file = splatvol.open(mesh_path)
    del file
    assert list(without_svbuild.iterdir()) == []


def test_pyvista_reads_pieces_and_steps(tmp_path, without_svbuild):
    pv = pytest.importorskip("pyvista")
    whole = pv.read(write_mesh(tmp_path / "whole.vtk"))
    for i, half in enumerate([whole.clip("x", crinkle=True), whole.clip("-x", crinkle=True)]):
        half.point_data.pop("vtkOriginalPointIds", None)
        half.clear_cell_data()
        half.save(tmp_path / f"{i}.vtu")
    pieces = splatvol.open([tmp_path / "0.vtu", tmp_path / "1.vtu"])
    assert pieces.cells().n_cells >= whole.n_cells and pieces.bounds[0][0] < -.9 and pieces.bounds[1][0] > .9
    steps = "".join(f'<DataSet timestep="{1.5 * i}" file="s{i}.vtu"/>' for i in range(2))
    (tmp_path / "s.pvd").write_text(f'<VTKFile type="Collection"><Collection>{steps}</Collection></VTKFile>')
    for i in range(2):
        pv.read(write_mesh(tmp_path / "step.vtk", i)).save(tmp_path / f"s{i}.vtu")
    last = splatvol.open(tmp_path / "s.pvd")
    assert last.times == [] and last.attributes[0].high == pytest.approx(linear(whole.points).max() + 1, abs=1e-3)
    series = splatvol.open(tmp_path / "s.pvd", time=.1)
    assert series.times == [0, 1.5] and series.step == 0
    whole.save(tmp_path / "s0.vtu")
    whole.points *= 2
    whole.save(tmp_path / "s1.vtu")
    with pytest.raises(splatvol.UnsupportedError, match="changes from step to step: svbuild"):
        splatvol.open(tmp_path / "s.pvd", step=0)


def test_what_pyvista_does_not_read(tmp_path, without_svbuild):
    pytest.importorskip("pyvista")
    (tmp_path / "a.msh").write_text("nothing of Gmsh")
    with pytest.raises(splatvol.InvalidDataError, match=r"a.msh: PyVista .*svbuild may") as caught:
        splatvol.open(tmp_path / "a.msh")
    assert "\n" not in str(caught.value)
    surface = pytest.importorskip("pyvista").Sphere()
    surface["v"] = surface.points[:, 0]
    surface.save(tmp_path / "sphere.vtp")
    with pytest.raises(splatvol.Error, match="sphere.vtp"):
        splatvol.open(tmp_path / "sphere.vtp")
    assert list(without_svbuild.iterdir()) == []


@pytest.fixture()
def svbuild(program, monkeypatch, tmp_path):
    """svbuild on PATH, with a cache of its own. Where the build names the program, it has to be there."""
    path = os.environ.get("SPLATVOL_SVBUILD") or program("svbuild")
    monkeypatch.setenv("PATH", f"{os.path.dirname(path)}:/usr/bin:/bin")
    monkeypatch.setenv("SPLATVOL_CACHE", str(tmp_path / "cache"))
    assert os.path.samefile(shutil.which("svbuild"), path)


def test_the_real_svbuild(svbuild, mesh_path, tmp_path, monkeypatch):
    shares = []
    with splatvol.open(mesh_path, progress=lambda stage, share: shares.append(share)) as file:
        assert shares == sorted(shares) and file.path.startswith(str(tmp_path / "cache"))
        positions = file.points().positions
        np.testing.assert_allclose(file.sample(.5 * positions, "T"), linear(.5 * positions), atol=2e-3)
        assert file.render(size=(30, 20)).any()
        first = file.path, os.stat(file.path).st_mtime_ns
    with splatvol.open(mesh_path) as file:  # of the cache
        assert (file.path, os.stat(file.path).st_mtime_ns) == first
    monkeypatch.setenv("SPLATVOL_CACHE", "")
    with pytest.warns(UserWarning, match="the file is temporary"):
        file = splatvol.open(mesh_path)
    path = file.path
    assert os.path.exists(path) and not path.startswith(str(tmp_path / "cache"))
    file.close()
    assert not os.path.exists(path)


def test_the_real_svbuild_with_steps_and_errors(svbuild, tmp_path):
    series = write_series(tmp_path)
    assert splatvol.open(series).attributes[0].high == pytest.approx(linear(ball(4)[0]).max() + 1, abs=2e-3)
    file = splatvol.open(series, step=0)
    assert file.times == [0, 1.5] and file.step == 0 and file.time == 0
    assert splatvol.open(series, time=1.4).step == 1
    (tmp_path / "bad.vtu").write_text("<VTKFile")
    with pytest.raises(splatvol.Error, match="bad.vtu") as caught:
        splatvol.open(tmp_path / "bad.vtu")
    assert "\n" not in str(caught.value)
