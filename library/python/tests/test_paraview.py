"""The reader for ParaView, run by VTK: decorators that do nothing stand for ParaView's, if it is absent."""

import importlib.util
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import splatvol
from conftest import linear

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402

PLUGIN = Path(__file__).parents[1] / "paraview" / "SplatvolReader.py"


class Decorators:
    """Any attribute is a decorator with arguments, which returns what it decorates."""

    def __getattr__(self, name):
        return lambda *args, **kwargs: lambda decorated: decorated


@pytest.fixture()
def plugin(monkeypatch):
    if importlib.util.find_spec("paraview") is None:
        package, util, algorithm = (types.ModuleType(name) for name in ("paraview", "util", "vtkAlgorithm"))
        algorithm.smproxy = algorithm.smproperty = algorithm.smdomain = algorithm.smhint = Decorators()
        monkeypatch.setitem(sys.modules, "paraview", package)
        monkeypatch.setitem(sys.modules, "paraview.util", util)
        monkeypatch.setitem(sys.modules, "paraview.util.vtkAlgorithm", algorithm)
    spec = importlib.util.spec_from_file_location("SplatvolReader", PLUGIN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read(reader):
    reader.Update()
    return reader.GetOutputDataObject(0)


def test_points_and_attributes(plugin, ball_path):
    reader = plugin.SplatvolReader()
    reader.SetFileName(str(ball_path))
    reader.UpdateInformation()
    selection = reader.GetDataArraySelection()
    assert selection.GetNumberOfArrays() == 5
    output = read(reader)
    file = splatvol.open(ball_path)
    assert output.GetNumberOfPoints() == output.GetNumberOfVerts() == file.point_count
    points = vtk_to_numpy(output.GetPoints().GetData())
    np.testing.assert_allclose(vtk_to_numpy(output.GetPointData().GetArray("T")), linear(points), rtol=1e-5)
    selection.DisableArray("U")
    assert read(reader).GetPointData().GetArray("U") is None


def test_resolutions_and_boxes(plugin, ball_path):
    counts = splatvol.open(ball_path).resolution_counts
    reader = plugin.SplatvolReader()
    reader.SetFileName(str(ball_path))
    reader.SetResolution(0)
    assert read(reader).GetNumberOfPoints() == counts[0]
    reader.SetResolution(-1)
    reader.SetMaxPoints(counts[-1] - 1)
    assert read(reader).GetNumberOfPoints() == counts[-2]
    reader.SetMaxPoints(counts[-1])
    reader.SetUseBox(1)
    low, high = read(reader).GetBounds()[::2], read(reader).GetBounds()[1::2]
    assert min(low) >= 0 and max(high) <= 1


def test_steps_are_time_steps(plugin, series_path):
    times = splatvol.open(series_path).times
    reader = plugin.SplatvolReader()
    reader.SetFileName(str(series_path))
    assert reader.GetTimestepValues() == times
    means = []
    for time in [*times, times[-1] + 9]:
        reader.UpdateTimeStep(time)
        means.append(vtk_to_numpy(reader.GetOutputDataObject(0).GetPointData().GetArray("T")).mean())
    assert means[1] == means[2] == pytest.approx(means[0] + 1, abs=.01)


# ParaView 5.11 calls a function that Python 3.11 has no more: Debian 12 has both, and so loads no plugins in Python.
IN_PARAVIEW = """
import inspect, sys
if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec
sys.path[:0] = {path!r}
from paraview.simple import LoadPlugin, OpenDataFile
LoadPlugin({plugin!r}, remote=False, ns=globals())
reader = OpenDataFile({file!r})
reader.UpdatePipeline()
print(reader.GetDataInformation().GetNumberOfPoints())
reader.Resolution = 0
reader.Attributes = ["T"]
reader.UpdatePipeline()
print(reader.GetDataInformation().GetNumberOfPoints(), reader.PointData.keys())
"""


def test_in_paraview(ball_path, tmp_path):
    """With a program pvpython, of SPLATVOL_PVPYTHON or on PATH, whose Python has this one's version."""
    pvpython = os.environ.get("SPLATVOL_PVPYTHON") or shutil.which("pvpython")
    if pvpython is None:
        pytest.skip("no pvpython: set SPLATVOL_PVPYTHON")
    # Alone: a VTK beside it would take the place of ParaView's.
    for part in Path(splatvol.__file__).parents[1].glob("splatvol*"):
        (tmp_path / part.name).symlink_to(part)
    code = IN_PARAVIEW.format(path=[str(tmp_path)], plugin=str(PLUGIN), file=str(ball_path))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    told = subprocess.run([pvpython, "-c", code], capture_output=True, text=True, env=environment)
    assert told.returncode == 0, told.stderr
    counts = splatvol.open(ball_path).resolution_counts
    expected = [str(counts[-1]), f"{counts[0]} ['T']"]
    assert told.stdout.splitlines()[:2] == expected, told.stdout + told.stderr
