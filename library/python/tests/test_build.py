import os

import numpy as np
import pytest

import splatvol
from conftest import ball, cube_corners, hexahedra, lattice, linear
from splatvol._build import _floats, _indices


def sorted_rows(points, values):
    rows = np.column_stack([points, values])
    return rows[np.lexsort(rows.T[::-1])]


def test_exact_files_give_back_points_and_values(tmp_path, ball_mesh):
    points, cells = ball_mesh
    values = linear(points).astype(np.float32)
    report = splatvol.build(points, cells, {"T": values}, tmp_path / "a.svol", exact=True)
    read = splatvol.open(tmp_path / "a.svol").points()
    assert report.resolution_counts[-1] == len(points)
    assert report.file_bytes == os.path.getsize(tmp_path / "a.svol")
    assert report.connectivity == "mesh"
    assert report.kept_cells == len(cells)
    np.testing.assert_array_equal(sorted_rows(read.positions, read.values["T"]), sorted_rows(points, values))


@pytest.mark.parametrize("types", [(np.float32, np.float32), (np.float64, np.float64), (np.float32, np.float64)])
def test_arrays_of_floats_are_not_copied(types):
    points = np.zeros((10, 3), types[0])
    values = np.zeros(10, types[1])
    assert np.shares_memory(_floats(points), points) and np.shares_memory(_floats(values), values)
    cells = np.zeros((2, 4), np.int64)
    assert np.shares_memory(_indices(cells, "cells"), cells)


def test_single_precision_and_strided_arrays_give_the_same_file(tmp_path, ball_mesh):
    points, cells = ball_mesh
    points = points.astype(np.float32)
    values = linear(points).astype(np.float32)
    splatvol.build(points, cells, {"T": values}, tmp_path / "a.svol")
    wide = np.zeros((len(points), 6), np.float32)
    wide[:, ::2] = points
    splatvol.build(wide[:, ::2], cells.astype(np.int32), {"T": values}, tmp_path / "b.svol")
    assert (tmp_path / "a.svol").read_bytes() == (tmp_path / "b.svol").read_bytes()


def test_read_only_arrays_are_read(tmp_path):
    points, cells = ball(4)
    for array in (points, cells):
        array.flags.writeable = False
    splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "a.svol")


def test_points_without_cells(tmp_path):
    points = np.random.default_rng(2).random((500, 3))
    report = splatvol.build(points, None, {"v": points[:, 0]}, tmp_path / "a.svol", connectivity="none")
    assert report.connectivity == "none"
    assert splatvol.open(tmp_path / "a.svol").point_count == 500


def test_nan_and_fill_values_are_missing(tmp_path, ball_mesh):
    points, cells = ball_mesh
    values = linear(points)
    values[:7] = np.nan
    values[7:10] = -9999
    splatvol.build(points, cells, {"T": values}, tmp_path / "a.svol", missing=[-9999])
    file = splatvol.open(tmp_path / "a.svol")
    assert file.attributes[0].missing == 10
    assert np.isnan(file.points().values["T"]).sum() == 10


@pytest.mark.parametrize("number", [np.float32, np.float64, np.int32])
def test_masked_values_are_missing(tmp_path, ball_mesh, number):
    points, cells = ball_mesh
    masked = np.ma.masked_array(np.rint(linear(points)).astype(number), fill_value=123)
    masked.data[:7] = 9999
    masked[:7] = np.ma.masked
    vectors = np.ma.masked_array(np.ones((len(points), 3)), mask=False)
    vectors[3, 1] = np.ma.masked
    splatvol.build(points, cells, {"T": masked, "U": vectors}, tmp_path / "a.svol")
    file = splatvol.open(tmp_path / "a.svol")
    assert {a.name: a.missing for a in file.attributes} == {"T": 7, "U": 1, "U[0]": 0, "U[1]": 1, "U[2]": 0}
    assert np.nanmax(file.points().values["T"]) < 9999
    assert masked.data[0] == 9999


def test_masks_are_seen_in_cells_lists_and_series(tmp_path):
    points, cells = lattice(4), hexahedra(4)
    of_cells = np.ma.masked_less(linear(points[cells].mean(axis=1)), 0)
    report = splatvol.build(points, cells, None, tmp_path / "a.svol", cell_values={"T": of_cells}, own_cells=True)
    assert report.census["missing values: T"] == of_cells.mask.sum() > 0
    rows = [np.ma.masked_array([row, row], mask=[i == 0, False]) for i, row in enumerate(points[:, 0])]
    splatvol.build(points, cells, {"v": rows}, tmp_path / "b.svol")
    assert {a.name: a.missing for a in splatvol.open(tmp_path / "b.svol").attributes}["v[0]"] == 1
    at_points = np.ma.masked_less(points[:, 0], -0.9)
    steps = [splatvol.Step(0, {"x": at_points}), splatvol.Step(1, {"x": at_points})]
    splatvol.build_series(points, cells, steps, tmp_path / "c.svol")
    assert splatvol.open(tmp_path / "c.svol").attributes[0].missing == at_points.mask.sum()


def test_masks_that_hide_nothing_copy_nothing():
    values = np.zeros(10)
    assert np.shares_memory(_floats(np.ma.masked_array(values, mask=False)), values)


def test_masked_positions_and_numbers_of_points_are_refused(tmp_path):
    points, cells = lattice(2), hexahedra(2)
    values = {"T": linear(points)}
    masked_points = np.ma.masked_array(points, mask=np.zeros(points.shape, bool))
    masked_points[3, 1] = np.ma.masked
    with pytest.raises(splatvol.InvalidArgumentError, match="points: masked numbers"):
        splatvol.build(masked_points, cells, values, tmp_path / "a.svol")
    masked_cells = np.ma.masked_equal(cells, 0)
    with pytest.raises(splatvol.InvalidArgumentError, match="cells: masked numbers"):
        splatvol.build(points, masked_cells, values, tmp_path / "a.svol")
    assert not (tmp_path / "a.svol").exists()


def test_values_of_cells_are_averaged_or_kept(tmp_path):
    points, cells = lattice(4), hexahedra(4)
    values = linear(points[cells].mean(axis=1))
    averaged = splatvol.build(points, cells, {}, tmp_path / "a.svol", cell_values={"T": values})
    assert averaged.conversions == ["T: of cells, averaged to points"]
    assert splatvol.open(tmp_path / "a.svol").point_count == len(points)
    splatvol.build(points, cells, None, tmp_path / "b.svol", cell_values={"T": values}, own_cells=True, exact=True)
    own = splatvol.open(tmp_path / "b.svol").points()
    np.testing.assert_allclose(np.sort(own.values["T"]), np.sort(values), rtol=1e-6)


@pytest.mark.parametrize("corners", [[0, 1, 3, 2, 4], [0, 2, 1, 4, 6, 5], [0, 1, 3, 2, 4, 5, 7, 6]])
def test_one_type_of_cells(tmp_path, corners):
    points = lattice(2)
    cells = cube_corners(2)[:, corners]
    splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "a.svol")
    splatvol.open(tmp_path / "a.svol").verify()


def test_mixed_cells_as_in_vtk(tmp_path):
    points, corners = lattice(1), cube_corners(1)[0]
    connectivity = np.concatenate([corners[[0, 1, 3, 2, 4]], corners[[1, 3, 4, 7]]])
    splatvol.build(points, (connectivity, [0, 5, 9], [14, 10]), {"T": linear(points)}, tmp_path / "a.svol")


def test_vectors_have_a_magnitude_and_components(ball_file):
    assert [a.name for a in ball_file.attributes] == ["T", "U", "U[0]", "U[1]", "U[2]"]
    assert ball_file.attributes[0].unit == "K"


def test_progress_and_its_errors(tmp_path, ball_mesh):
    points, cells = ball_mesh
    seen = []
    splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "a.svol", progress=lambda *a: seen.append(a))
    assert [stage for stage, _ in seen][-1] == "checking"
    assert all(0 <= share <= 1 for _, share in seen)

    def fail(stage, share):
        raise ZeroDivisionError(stage)

    with pytest.raises(ZeroDivisionError):
        splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "b.svol", progress=fail)


def test_errors_of_arrays(tmp_path, ball_mesh):
    points, cells = ball_mesh
    path = tmp_path / "a.svol"
    values = {"T": linear(points)}
    wrong = cells.copy()
    wrong[3, 2] = len(points)
    for arguments, message in [
        ((points[:, :2], cells, values, path), r"\(n, 3\)"),
        ((points, cells[:, :3], values, path), "tetrahedra"),
        ((points, cells, {"T": values["T"][:-1]}, path), "T: "),
        ((points, cells, {}, path), "no values"),
        ((points, cells, values, tmp_path / "a.vtu"), "must end in .svol"),
        ((points, cells.astype(float), values, path), "whole numbers"),
        ((points, cells, {"T": values["T"].astype(str)}, path), "numbers are needed"),
        ((points, (cells.ravel(), [0, 4], [10, 10]), values, path), "offsets"),
        ((points, wrong, values, path), "point"),
        ((points, (cells.ravel(), [0, 4], [10.5]), values, path), "types"),
    ]:
        with pytest.raises(splatvol.Error, match=message) as caught:
            splatvol.build(*arguments)
        assert isinstance(caught.value, ValueError)
    with pytest.raises(splatvol.InvalidArgumentError, match="delaunay"):
        splatvol.build(points, cells, values, path, connectivity="lines")
    with pytest.raises(splatvol.InvalidArgumentError, match="unit of p"):
        splatvol.build(points, cells, values, path, units={"p": "Pa"})
    assert not path.exists()


def test_a_folder_that_is_absent_is_a_file_error(tmp_path, ball_mesh):
    points, cells = ball_mesh
    with pytest.raises(splatvol.FileError) as caught:
        splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "no" / "a.svol")
    assert isinstance(caught.value, OSError) and isinstance(caught.value, splatvol.Error)
