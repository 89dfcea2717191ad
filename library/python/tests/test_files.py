import os
import shutil
import sys

import numpy as np
import pytest

import splatvol
from conftest import linear


def test_what_a_file_tells(ball_file, ball_mesh):
    low, high = ball_file.bounds
    assert low == pytest.approx(ball_mesh[0].min(axis=0), abs=1e-3)
    assert high == pytest.approx(ball_mesh[0].max(axis=0), abs=1e-3)
    assert ball_file.point_count == len(ball_mesh[0]) == ball_file.resolution_counts[-1]
    assert ball_file.times == [] and ball_file.step == 0
    assert ball_file.attributes[0].low == pytest.approx(linear(ball_mesh[0]).min(), rel=1e-6)
    assert "ball.svol" in repr(ball_file)


def test_points_own_their_buffers(ball_path):
    points = splatvol.open(ball_path).points(material=True)
    assert points.positions.shape == points.centroids.shape == (len(points.volumes), 3)
    assert points.covariances.shape == (len(points.volumes), 6)
    assert points.positions.flags.writeable and points.positions.base is not None
    # The file is closed by now; the arrays stay.
    assert points.volumes.sum() == pytest.approx(4 / 3 * np.pi, rel=.03)
    np.testing.assert_allclose(points.values["T"], linear(points.positions), rtol=1e-5)
    np.testing.assert_allclose(points.means["T"], linear(points.centroids), atol=.01)


def test_resolutions_boxes_and_attributes(ball_file):
    counts = ball_file.resolution_counts
    assert len(ball_file.points(0).positions) == counts[0]
    assert ball_file.points(max_points=counts[-1] - 1).resolution == len(counts) - 2
    inside = ball_file.points(box=((0, 0, 0), (1, 1, 1)), attributes=["U[1]"])
    assert list(inside.values) == ["U[1]"] and (inside.positions >= 0).all() and len(inside.positions) > 0
    assert len(inside.volumes) == 0 and inside.means == {}


def test_samples_of_a_linear_field_are_that_field(ball_file):
    random = np.random.default_rng(4).uniform(-1, 1, (2000, 3))
    inside = random[np.linalg.norm(random, axis=1) < .85]
    np.testing.assert_allclose(ball_file.sample(inside), linear(inside), atol=1e-6)
    of_splats = ball_file.sample(inside, resolution=len(ball_file.resolution_counts) - 1)
    np.testing.assert_allclose(of_splats, linear(inside), atol=.02)
    outside = random[np.linalg.norm(random, axis=1) > 1.3]
    assert np.isnan(ball_file.sample(outside, "T")).all()
    assert ball_file.sample(np.empty((0, 3))).shape == (0,)


def test_samples_of_cells_are_the_meshs(ball_file):
    points = ball_file.points()
    np.testing.assert_array_equal(ball_file.sample(points.positions), points.values["T"])
    inside = .5 * points.positions + .1
    np.testing.assert_allclose(ball_file.sample(inside), linear(inside), atol=1e-6)


def test_a_line_has_all_crossings(ball_file):
    line = ball_file.sample_line((-2, .1, .2), (2, .2, .1))
    assert list(line.values) == ["T", "U", "U[0]", "U[1]", "U[2]"]
    values = line.values["T"]
    assert len(values) > 32 and np.isnan(values[[0, 1, -2, -1]]).all() and not np.isnan(values[2:-2]).any()
    np.testing.assert_allclose(values[2:-2], linear(line.positions[2:-2]), atol=1e-6)
    np.testing.assert_allclose(line.arc_lengths, np.linalg.norm(line.positions - line.positions[0], axis=1), atol=1e-12)
    even = ball_file.sample_line((-2, .1, .2), (2, .2, .1), "T", samples=30)
    np.testing.assert_allclose(even.values["T"], ball_file.sample(even.positions), atol=1e-12)
    with pytest.raises(splatvol.InvalidArgumentError, match="no length"):
        ball_file.sample_line((0, 0, 0), (0, 0, 0))


def test_streamlines_turn(ball_file):
    seeds = [(.5, 0, .1), (3, 0, 0)]
    turn, outside = ball_file.streamlines("U", seeds, direction="forward", max_length=np.pi)
    assert turn.begin == "seed" and turn.end == "length" and turn.times[-1] == pytest.approx(2 * np.pi, rel=1e-3)
    np.testing.assert_allclose(turn.positions[-1], seeds[0], atol=1e-3)
    np.testing.assert_allclose(turn.values["T"], linear(turn.positions), atol=1e-6)
    assert len(outside.positions) == 0 and outside.end == "mesh"
    assert len(ball_file.streamlines("U", seeds, max_steps=3, attributes="T")[0].times) == 7
    for wrong, match in [({"seeds": seeds, "direction": "up"}, "none of both"), ({}, "give one of both"),
                         ({"seeds": [1, 2]}, "shape"), ({"patch": "inlet"}, "--boundary"),
                         ({"seeds": [(9, 9, 9)]}, "no seed")]:
        with pytest.raises(splatvol.InvalidArgumentError, match=match):
            ball_file.streamlines("U", **wrong)


def test_integrals_are_exact(tmp_path):
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    cube = [(0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7)]
    values = {"f": corners @ (1, 2, 4), "g": np.where(corners[:, 0] > 0, 1, np.nan)}
    splatvol.build(corners, cube, values, tmp_path / "cube.svol", units={"f": "K"}, exact=True)
    file = splatvol.open(tmp_path / "cube.svol")
    whole = file.integrate()
    assert list(whole) == ["f", "g"] and whole["f"].unit == "K"
    assert whole["f"].integral == pytest.approx(3.5) and whole["f"].mean == pytest.approx(3.5)
    assert (whole["f"].low, whole["f"].low_position) == (0, (0, 0, 0))
    assert (whole["f"].high, whole["f"].high_position) == (7, (1, 1, 1))
    assert whole["g"].volume == 0 and whole["g"].missing_volume == pytest.approx(1) and np.isnan(whole["g"].mean)
    box = ((.2, 0, 0), (.6, 1, 1))
    part = file.integrate("f", box=box, clip_planes=[((0, 0, .5), (0, 0, -1))])
    assert list(part) == ["f"] and part["f"].volume == pytest.approx(.2) and part["f"].mean == pytest.approx(2.4)
    assert file.integrate("f", ranges={"f": (None, 1)})["f"].volume == pytest.approx(1 / 48)
    with pytest.warns(UserWarning, match="a volume of 0.4 is left out"):
        assert file.integrate("f", box=box, ranges={"g": (0, None)})["f"].volume == 0
    with pytest.raises(splatvol.InvalidArgumentError, match="lower value first"):
        file.integrate(ranges={"f": (2, 1)})
    slice = file.integrate_surface(slice=((.5, .5, .25), (0, 0, 1)), box=((0, 0, 0), (.5, 1, 1)))
    assert slice.area == pytest.approx(.5) and np.isnan(slice.flux)
    assert slice.attributes["f"].mean == pytest.approx(2.25) and slice.attributes["g"].missing_area == slice.area
    contour = file.integrate_surface(contour=("f", 1))  # x + 2 y + 4 z = 1
    assert contour.area == pytest.approx(np.sqrt(21) / 16) and np.isnan(contour.enclosed_volume)
    for wrong in ({}, {"contour": ("f", 1), "slice": ((0, 0, 0), (1, 0, 0))}):
        with pytest.raises(splatvol.InvalidArgumentError, match="either"):
            file.integrate_surface(**wrong)
    with pytest.raises(splatvol.InvalidArgumentError, match="heat"):
        file.integrate(ranges={"heat": (1, 2)})


def test_data_sets_need_pyvista(ball_file, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    for call in (ball_file.cells, lambda: ball_file.contour(1)):
        with pytest.raises(splatvol.UnsupportedError, match="which is not installed: pip install pyvista"):
            call()


def test_cells_are_kept(ball_mesh, tmp_path):
    pytest.importorskip("pyvista")
    points, cells = ball_mesh
    splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "a.svol", keep_cells=False)
    for call in (splatvol.File.cells, lambda file: file.contour(1)):
        with pytest.raises(splatvol.InvalidArgumentError, match="keeps no cells"):
            call(splatvol.open(tmp_path / "a.svol"))


def test_verify_tells_its_progress(ball_file):
    shares = []
    ball_file.verify(shares.append)
    assert shares and shares == sorted(shares) and shares[-1] <= 1


def test_a_with_block_closes_the_file(ball_path):
    with splatvol.open(ball_path) as file:
        points = file.points()
        assert file.render(size=(8, 8)).any()
    np.testing.assert_allclose(points.values["T"], linear(points.positions), rtol=1e-5)
    assert file.name == str(ball_path) and repr(file).endswith("closed")
    for call in (file.points, file.render, file.scene, lambda: file.attributes, file.__enter__,
                 lambda: next(file.frames())):
        with pytest.raises(splatvol.InvalidArgumentError, match="ball.svol: the file is closed"):
            call()
    file.close()


def test_missing_files_are_pythons(ball_file, tmp_path):
    absent = tmp_path / "absent.svol"
    for call in (lambda: splatvol.open(absent), lambda: splatvol.open(tmp_path / "no" / "a.svols"),
                 lambda: ball_file.render(absent), lambda: splatvol.check_scene(absent)):
        with pytest.raises(FileNotFoundError, match="No such file") as caught:
            call()
        assert isinstance(caught.value, splatvol.MissingFileError) and isinstance(caught.value, splatvol.FileError)
    with pytest.raises(splatvol.FileError) as caught:
        splatvol.open(tmp_path)
    assert not isinstance(caught.value, FileNotFoundError)


def test_errors(ball_file, ball_path, tmp_path):
    with pytest.raises(splatvol.InvalidArgumentError, match="attribute"):
        ball_file.points(attributes=["q"])
    with pytest.raises(splatvol.Error):
        ball_file.points(resolution=99)
    with pytest.raises(splatvol.InvalidArgumentError, match="no step 3"):
        ball_file.show_step(3)
    with pytest.raises(splatvol.InvalidArgumentError, match=r"\(n, 3\)"):
        ball_file.sample([1, 2, 3])
    damaged = tmp_path / "damaged.svol"
    shutil.copy(ball_path, damaged)
    with damaged.open("r+b") as file:
        file.seek(damaged.stat().st_size // 2)
        file.write(b"\xff" * 64)
    with pytest.raises(splatvol.InvalidDataError, match="damaged.svol"):
        splatvol.open(damaged).verify()
    damaged.write_bytes(ball_path.read_bytes()[:1000])
    with pytest.raises(splatvol.InvalidDataError):
        splatvol.open(damaged)


def test_wrong_types_are_type_errors(ball_file):
    with pytest.raises(TypeError):
        ball_file.points(resolution="fine")
    calls = {
        "size=800: take the width": lambda: ball_file.render(size=800),
        "size=.20.5, 10.: take the width": lambda: ball_file.render(size=(20.5, 10)),
        "size=8: take the width": lambda: ball_file.scene(size=8),
        "size='ab': take the width": lambda: next(ball_file.frames(size="ab")),
        "no option 'max_eror': did you mean max_error": lambda: ball_file.render(max_eror=.1),
        "no option 'sise': did you mean size": lambda: next(ball_file.frames(sise=8)),
        "no option 'colour': it has attribute, depths, ": lambda: ball_file.render(colour=1),
        "max_error='low': take a number": lambda: ball_file.render(max_error="low"),
        "splats=1.5: take a whole number": lambda: ball_file.render(splats=1.5),
        "memory='1G': take a whole number": lambda: ball_file.render(memory="1G"),
        "names and units are texts": lambda: splatvol.build([[0, 0, 0]], None, {"p": [1]}, "a", units={"p": 3}),
        "no option 'strikt': did you mean strict": lambda: splatvol.build_series([[0, 0, 0]], None, [], "a", strikt=1),
    }
    for words, call in calls.items():
        with pytest.raises(TypeError, match=words) as caught:
            call()
        assert "__init__" not in str(caught.value) and "\n" not in str(caught.value)


def test_names_of_any_bytes(ball_path, tmp_path):
    name = bytes(tmp_path) + b"/\xff \xc3\xa4.svol"
    shutil.copy(ball_path, name)
    for path in (name, os.fsdecode(name)):
        assert splatvol.open(path).render(size=(8, 8)).shape == (8, 8, 4)
    assert splatvol.open(name).name.endswith("\\xff \u00e4.svol")
    with pytest.raises(splatvol.FileError, match="cannot open"):
        splatvol.open(name + b"x")
