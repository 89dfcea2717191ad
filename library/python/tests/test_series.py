"""Time series: built, appended to, read and drawn."""

import numpy as np
import pytest

import splatvol
from conftest import ball, linear

WHERE = [[0, 0, .1]]


def steps_of(points, times):
    """Values that are the time more than at time 0."""
    for time in times:
        yield time, {"T": linear(points) + time}


@pytest.fixture()
def mesh():
    return ball(4)


def test_steps_are_chosen_by_number_and_by_time(series_path):
    file = splatvol.open(series_path)
    assert file.times == [0, 1] and file.step == 1 and file.time == 1
    last = file.sample(WHERE)
    for opened in (splatvol.open(series_path, step=0), splatvol.open(series_path, time=.4)):
        assert opened.step == 0 and opened.time == 0
        np.testing.assert_allclose(opened.sample(WHERE), last - 1, atol=.01)
    file.show_time(.5)  # as near to both: the earlier
    assert file.step == 0
    file.show_time(100)
    assert file.step == 1
    for wrong in (dict(step=2), dict(step=0, time=0.), dict(time=float("nan")), dict(time=float("inf"))):
        with pytest.raises(splatvol.InvalidArgumentError):
            splatvol.open(series_path, **wrong)


def test_ranges_are_those_of_all_steps(series_path, mesh):
    file = splatvol.open(series_path, step=0)
    values = linear(mesh[0])
    assert file.range_of("T") == pytest.approx((values.min(), values.max() + 1), abs=.01)
    assert file.attributes[0].high == pytest.approx(values.max(), abs=.01)
    with pytest.raises(splatvol.InvalidArgumentError, match="'q'"):
        file.range_of("q")


def test_a_file_without_steps(ball_path):
    file = splatvol.open(ball_path, step=0)
    assert file.times == [] and file.time is None
    with pytest.raises(splatvol.InvalidArgumentError, match="no time series"):
        file.show_time(0)


def test_pictures_follow_the_step(series_path):
    file = splatvol.open(series_path)
    scene = file.scene(size=(32, 32))
    last = file.render(scene)
    file.show_step(0)
    first = file.render(scene)
    assert np.abs(first - last).max() > .05
    file.show_step(1)
    np.testing.assert_array_equal(file.render(scene), last)
    with pytest.raises(splatvol.InvalidArgumentError, match="no step 2"):
        file.show_step(2)
    assert file.step == 1


@pytest.mark.parametrize("scattered", [False, True])
def test_steps_are_appended(mesh, tmp_path, scattered):
    points, cells = mesh[0], None if scattered else mesh[1]
    path = tmp_path / "series.svol"
    report = splatvol.build_series(points, cells, steps_of(points, [0, 1]), path, units={"T": "K"}, exact=True)
    assert report.path == str(path) and report.resolution_counts[-1] == len(points)
    report = splatvol.build_series(points, cells, steps_of(points, [2.5, 4]), path, append=True, units={"T": "K"})
    assert report.file_bytes == path.stat().st_size
    file = splatvol.open(path)
    assert file.times == [0, 1, 2.5, 4] and file.attributes[0].unit == "K"
    for step, time in enumerate(file.times):
        file.show_step(step)
        read = file.points()
        np.testing.assert_allclose(read.values["T"], linear(read.positions) + time, rtol=1e-6)
    file.verify()


def test_values_of_cells(mesh, tmp_path):
    points, cells = mesh
    steps = [splatvol.Step(time, {}, {"c": np.full(len(cells), time)}) for time in (3.0, 5.0)]
    splatvol.build_series(points, cells, steps, tmp_path / "cells.svol", own_cells=True)
    file = splatvol.open(tmp_path / "cells.svol", time=3)
    assert file.point_count == len(cells) and file.attributes[0].high == 3
    file.show_step(1)
    assert file.attributes[0].low == 5


def test_what_does_not_fit_is_refused_and_changes_nothing(mesh, tmp_path):
    points, cells = mesh
    path = tmp_path / "series.svol"
    with pytest.raises(splatvol.InvalidArgumentError, match="rise"):
        splatvol.build_series(points, cells, steps_of(points, [1, 1]), path)
    with pytest.raises(splatvol.InvalidArgumentError, match="no step"):
        splatvol.build_series(points, cells, [], path)
    with pytest.raises(splatvol.InvalidArgumentError, match="no such array"):
        splatvol.build_series(points, cells, steps_of(points, [1]), path, units={"p": "Pa"})
    with pytest.raises(TypeError, match="colour"):
        splatvol.build_series(points, cells, steps_of(points, [1]), path, colour="red")
    assert not path.exists()

    splatvol.build_series(points, cells, steps_of(points, [1, 2]), path)
    before = path.read_bytes()
    others = [
        (points, cells, steps_of(points, [2])),
        (1.5 * points, cells, steps_of(points, [3])),
        (points, cells, [(3, {"q": linear(points)})]),
        (points, cells[1:], steps_of(points, [3])),
    ]
    for other in others:
        with pytest.raises(splatvol.Error):
            splatvol.build_series(*other, path, append=True)
        assert path.read_bytes() == before
    splatvol.build(points, cells, {"T": linear(points)}, path)
    with pytest.raises(splatvol.InvalidArgumentError, match="not a time series"):
        splatvol.build_series(points, cells, steps_of(points, [3]), path, append=True)
