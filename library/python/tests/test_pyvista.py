"""With PyVista and its VTK, drawn in software."""

import subprocess
from importlib.metadata import entry_points

import numpy as np
import pytest

import splatvol
from conftest import ball, hexahedra, lattice, linear

pv = pytest.importorskip("pyvista")
import splatvol.pyvista as splatvol_pyvista  # noqa: E402
from splatvol._vtk_arrays import POLYHEDRON, face_stream  # noqa: E402

pv.OFF_SCREEN = True


@pytest.fixture()
def grid():
    points, cells = ball(8)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: cells}, points)
    grid.point_data["T"] = linear(points).astype(np.float32)
    grid.cell_data["number"] = np.arange(grid.n_cells)
    return grid


def test_pyvista_finds_the_reader(ball_path):
    if not any(point.name == ".svol" for point in entry_points(group="pyvista.readers")):
        pytest.skip("the package is not installed")
    if not hasattr(pv, "register_reader"):
        pytest.skip("this PyVista has no entry points")
    assert pv.read(ball_path).n_points == splatvol.open(ball_path).point_count
    assert pv.read(ball_path, resolution=0).n_points == splatvol.open(ball_path).resolution_counts[0]


def test_points_as_a_data_set(ball_path):
    mesh = splatvol_pyvista.read(str(ball_path))
    assert mesh.n_points == splatvol.open(ball_path).point_count
    np.testing.assert_allclose(mesh.point_data["T"], linear(mesh.points), rtol=1e-5)
    coarse = splatvol_pyvista.read(str(ball_path), max_points=mesh.n_points - 1, attributes=["T"])
    assert coarse.n_points < mesh.n_points and coarse.point_data.keys() == ["T"]


def test_a_grid_gives_the_file_of_its_arrays(grid, tmp_path):
    splatvol.build_mesh(grid, tmp_path / "a.svol", arrays=["T"], units={"T": "K"})
    points, cells = ball(8)
    splatvol.build(grid.points, cells, {"T": linear(points).astype(np.float32)}, tmp_path / "b.svol", units={"T": "K"})
    assert (tmp_path / "a.svol").read_bytes() == (tmp_path / "b.svol").read_bytes()


def test_arrays_of_cells(grid, tmp_path):
    splatvol.build_mesh(grid, tmp_path / "a.svol", own_cells=True, arrays=["number"], exact=True)
    values = splatvol.open(tmp_path / "a.svol").points().values["number"]
    np.testing.assert_array_equal(np.sort(values), np.arange(grid.n_cells))


def test_other_data_sets_are_cast(tmp_path):
    image = pv.ImageData(dimensions=(5, 6, 7))
    image.point_data["T"] = np.arange(image.n_points, dtype=float)
    splatvol.build_mesh(image, tmp_path / "a.svol")
    assert splatvol.open(tmp_path / "a.svol").point_count == image.n_points


def test_a_plain_grid_of_vtk(grid, tmp_path):
    from vtkmodules.vtkCommonDataModel import vtkImageData, vtkUnstructuredGrid

    plain = vtkUnstructuredGrid()
    plain.ShallowCopy(grid)
    splatvol.build_mesh(plain, tmp_path / "a.svol", arrays=["T"])
    image = vtkImageData()
    image.ShallowCopy(pv.ImageData(dimensions=(3, 3, 3)))
    with pytest.raises(splatvol.InvalidArgumentError, match="no values"):
        splatvol.build_mesh(image, tmp_path / "b.svol")


def polyhedra(points, cells):
    """Returns hexahedra as polyhedra."""
    faces = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    numbers = []
    for cell in cells:
        stream = [len(faces)]
        for face in faces:
            stream += [len(face), *cell[face]]
        numbers += [len(stream), *stream]
    return pv.UnstructuredGrid(np.array(numbers), np.full(len(cells), pv.CellType.POLYHEDRON, np.uint8), points)


def test_polyhedra_are_the_hexahedra_that_they_are(tmp_path):
    points, cells = lattice(3), hexahedra(3)
    grid = polyhedra(points, cells)
    grid.point_data["T"] = linear(points)
    splatvol.build_mesh(grid, tmp_path / "a.svol")
    splatvol.build(points, cells, {"T": linear(points)}, tmp_path / "b.svol")
    a, b = (splatvol.open(tmp_path / f"{name}.svol").points(material=True) for name in "ab")
    assert a.volumes.sum() == pytest.approx(8, rel=1e-3)
    np.testing.assert_allclose(np.sort(a.volumes), np.sort(b.volumes), rtol=.35)


def test_the_stream_of_faces_of_mixed_cells():
    # A tetrahedron as a polyhedron, another cell, and a polyhedron that uses faces again.
    face_points = np.array([0, 1, 2, 0, 1, 3, 1, 2, 3, 2, 0, 3, 4, 5, 6, 7])
    face_offsets = np.array([0, 3, 6, 9, 12, 16])
    stream, locations = face_stream(face_points, face_offsets, np.array([0, 1, 2, 3, 4, 0]), np.array([0, 4, 4, 6]))
    assert locations.tolist() == [0, -1, 17]
    assert stream.tolist() == [4, 3, 0, 1, 2, 3, 0, 1, 3, 3, 1, 2, 3, 3, 2, 0, 3, 2, 4, 4, 5, 6, 7, 3, 0, 1, 2]
    assert POLYHEDRON == pv.CellType.POLYHEDRON


def test_errors_of_meshes(grid, tmp_path):
    with pytest.raises(splatvol.InvalidArgumentError, match="no array 'q'"):
        splatvol.build_mesh(grid, tmp_path / "a.svol", arrays=["q"])
    with pytest.raises(splatvol.InvalidArgumentError, match="data set"):
        splatvol.build_mesh([1, 2], tmp_path / "a.svol")
    with pytest.raises(TypeError, match="colour"):
        splatvol.build_mesh(grid, tmp_path / "a.svol", colour=1)
    for ghosts in ("vtkGhostType", "vtkGhostLevels"):
        copy = grid.copy()
        copy.cell_data[ghosts] = np.ones(grid.n_cells, np.uint8)
        with pytest.raises(splatvol.InvalidArgumentError, match="ghost"):
            splatvol.build_mesh(copy, tmp_path / "a.svol")
    with pytest.raises(splatvol.Error):
        splatvol.build_mesh(pv.Sphere(), tmp_path / "a.svol")


def test_cells_come_back(tmp_path):
    points, cells = lattice(4), hexahedra(4)
    velocity = points * [1, 2, 3]
    splatvol.build(points, cells, {"T": linear(points), "U": velocity}, tmp_path / "a.svol", exact=True)
    file = splatvol.open(tmp_path / "a.svol")
    grid = file.cells()
    file.close()
    assert (grid.celltypes == pv.CellType.HEXAHEDRON).all() and grid.n_cells == len(cells)
    assert grid.volume == pytest.approx(8)
    assert set(grid.point_data.keys()) == {"T", "U"} and grid.cell_data.keys() == []
    np.testing.assert_allclose(grid.point_data["U"], grid.points * [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(grid.point_data["T"], linear(grid.points), atol=1e-6)
    assert not grid.point_data["T"].flags.owndata and not grid.points.flags.owndata
    centers = {tuple(center) for center in np.round(grid.cell_centers().points, 6)}
    assert centers == {tuple(center) for center in np.round(points[cells].mean(axis=1), 6)}
    # The way back: the same cells.
    splatvol.build_mesh(grid, tmp_path / "b.svol", exact=True)
    again = splatvol.open(tmp_path / "b.svol")
    assert [a.name for a in again.attributes] == ["T", "U", "U[0]", "U[1]", "U[2]"]
    np.testing.assert_array_equal(again.cells().points, grid.points)


def test_cells_of_a_box_with_an_attribute(ball_file):
    box = ((0, 0, 0), (1, 1, 1))
    part = ball_file.cells("U[1]", box)
    assert part.point_data.keys() == ["U[1]"] and 0 < part.n_cells < ball_file.cells().n_cells / 4
    with pytest.raises(splatvol.InvalidArgumentError, match="no cells in the box"):
        ball_file.cells(box=((5, 5, 5), (6, 6, 6)))
    with pytest.raises(splatvol.InvalidArgumentError, match="attribute"):
        ball_file.cells("q")


def test_values_of_cells_come_back(tmp_path):
    points, cells = lattice(3), hexahedra(3)
    numbers = np.arange(len(cells))
    splatvol.build(points, cells, {}, tmp_path / "a.svol", cell_values={"n": numbers}, own_cells=True, exact=True)
    file = splatvol.open(tmp_path / "a.svol")
    grid = file.cells()
    assert sorted(grid.cell_data["n"]) == list(numbers) and grid.point_data.keys() == []
    expected = points[cells].mean(axis=1)[grid.cell_data["n"].astype(int)]
    np.testing.assert_allclose(grid.cell_centers().points, expected, atol=1e-6)
    with pytest.raises(splatvol.UnsupportedError, match="values of their own"):
        file.contour(3)


def test_a_contour_is_the_exact_one(tmp_path):
    points, cells = ball(16)
    radius = np.linalg.norm(points, axis=1)
    splatvol.build(points, cells, {"r": radius, "U": 2 * points}, tmp_path / "a.svol", exact=True)
    file = splatvol.open(tmp_path / "a.svol")
    surface = file.contour(.6)
    assert surface.n_open_edges == 0 and surface.area == pytest.approx(4 * np.pi * .36, rel=.02)
    np.testing.assert_allclose(surface.point_data["r"], .6)
    np.testing.assert_allclose(surface.point_data["U"], 2 * surface.points, atol=1e-6)
    flat = file.contour(0, "U[2]", attributes=["r"], box=((0, 0, -1), (1, 1, 1)))
    assert set(flat.point_data.keys()) == {"U[2]", "r"} and np.abs(flat.points[:, 2]).max() < 1e-6
    with pytest.raises(splatvol.InvalidArgumentError, match="nowhere 7"):
        file.contour(7)
    with pytest.raises(TypeError, match="value='r': take a number"):
        file.contour("r")


def test_meshes_are_those_of_svexport(ball_file, ball_path, tmp_path, program):
    svexport = program("svexport")

    def exported(name, *options):
        subprocess.run([svexport, ball_path, "-o", tmp_path / name, *options], check=True, capture_output=True)
        return pv.read(tmp_path / name)

    def expect_same(mesh, other):
        np.testing.assert_array_equal(mesh.points, other.points)
        assert set(mesh.point_data.keys()) == {"T", "U"} and mesh.point_data["U"].shape == (mesh.n_points, 3)
        for name in ("T", "U"):
            np.testing.assert_array_equal(mesh.point_data[name], other.point_data[name])

    cells = exported("cells.vtu", "--cells")
    expect_same(ball_file.cells(), cells)
    np.testing.assert_array_equal(ball_file.cells().cells, cells.cells)
    names = [word for name in ("T", "U", "U[0]", "U[1]", "U[2]") for word in ("--attribute", name)]
    surface = exported("surface.vtp", "--contour", "1.2", *names)
    expect_same(ball_file.contour(1.2, "T"), surface)
    np.testing.assert_array_equal(ball_file.contour(1.2, "T").faces, surface.faces)
    points = exported("points.vtu")
    np.testing.assert_allclose(points.point_data["U"][:, 0], points.points[:, 1], atol=1e-6)
    assert {"U mean", "U[1] mean"} < set(points.point_data.keys()) and "U[1]" not in points.point_data


def opaque_scene(density=.5):
    return {
        "attribute": "T", "background": [0, 0, 0], "image": {"width": 8, "height": 8},
        "camera": {"projection": "orthographic", "parallel_height": 3, "position": [0, 0, 10], "focal_point": [0, 0, 0],
                   "up": [0, 1, 0]},
        "transfer_function": {"domain": [-10, 10], "colors": [[0, 1, 1, 1]], "density": [[0, density]]},
    }


@pytest.fixture(params=["orthographic", "perspective"])
def plotter(request):
    plotter = pv.Plotter(off_screen=True, window_size=(200, 160), lighting="none")
    plotter.background_color = "black"
    plotter.camera_position = [(0, 0, 10), (0, 0, 0), (0, 1, 0)]
    if request.param == "orthographic":
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 1.5
    yield plotter
    plotter.close()


def test_depths_of_a_plane(plotter):
    plotter.add_mesh(pv.Plane(center=(0, .5, 1), i_size=1, j_size=1, direction=(0, 0, 1)), color="red")
    plotter.show(auto_close=False)
    depths = splatvol_pyvista.depths_of(plotter)
    assert depths.shape == (160, 200) and np.isnan(depths[0, 0])
    rows = np.nonzero(np.isfinite(depths).any(axis=1))[0]
    # The plane is in the upper half of the picture: in the first rows.
    assert rows.max() <= 81 and rows.min() < 60
    np.testing.assert_allclose(depths[np.isfinite(depths)], 9, rtol=2e-3)


def test_surfaces_and_volume_cover_each_other(plotter, ball_file):
    # A red plane halves the ball on the right side.
    plotter.add_mesh(pv.Plane(center=(2, 0, 0), i_size=4, j_size=8, direction=(0, 0, 1)), color="red", lighting=False)
    plotter.show(auto_close=False)
    picture = splatvol_pyvista.composite(plotter, ball_file, opaque_scene())
    assert picture.shape == (160, 200, 3)
    left, right = picture[80, 97], picture[80, 104]
    whole, half = 1 - np.exp(-1), 1 - np.exp(-.5)

    def srgb(linear_share):
        return 255 * (1.055 * linear_share ** (1 / 2.4) - .055)

    np.testing.assert_allclose(left, [srgb(whole)] * 3, atol=4)
    np.testing.assert_allclose(right, [255, srgb(half), srgb(half)], atol=4)
    assert (picture[5, 5] == 0).all() and (picture[5, 195] == [255, 0, 0]).all()


def test_the_overlay_shows_the_composited_picture(plotter, ball_file):
    plotter.add_mesh(pv.Cube(center=(0, 0, 0), x_length=.5, y_length=.5, z_length=3), color="blue", lighting=False)
    plotter.show(auto_close=False)
    overlay = splatvol_pyvista.add_volume(plotter, ball_file, opaque_scene(), tolerance=0)
    picture = overlay.update()
    shown = np.asarray(plotter.screenshot(return_img=True))[..., :3].astype(int)
    np.testing.assert_allclose(shown, picture, atol=1)
    plotter.camera.azimuth = 30
    assert (overlay.update() != picture).any()
    overlay.remove()
    plotter.render()
    assert (np.asarray(plotter.screenshot(return_img=True))[..., 0] == 0).all()


def test_a_screenshot_has_the_volume(ball_file):
    plotter = pv.Plotter(off_screen=True, window_size=(60, 50))
    plotter.background_color = "black"
    plotter.camera_position = [(0, 0, 10), (0, 0, 0), (0, 1, 0)]
    overlay = splatvol_pyvista.add_volume(plotter, ball_file, opaque_scene())
    first = np.asarray(plotter.screenshot())
    assert first[25, 30].min() > 150 and (first[2, 2] == 0).all()
    # It follows the camera and the surfaces.
    plotter.camera.focal_point = (1, 0, 0)
    plotter.render()
    second = np.asarray(plotter.screenshot())
    assert (second != first).mean() > .02
    plotter.add_mesh(pv.Cube(center=(0, 0, 2)), color="red", lighting=False)
    plotter.render()
    third = np.asarray(plotter.screenshot())
    assert (third == [255, 0, 0]).all(axis=-1).mean() > .01
    np.testing.assert_allclose(third.astype(int), overlay.update(), atol=1)
    overlay.remove()
    plotter.render()
    assert (np.asarray(plotter.screenshot())[..., 1] == 0).all()
    plotter.close()
    with pytest.raises(TypeError, match="did you mean max_error"):
        splatvol_pyvista.add_volume(plotter, ball_file, max_eror=.1)


def test_the_overlay_follows_the_mouse(plotter, ball_file):
    plotter.add_mesh(pv.Cube(), color="blue")
    plotter.show(auto_close=False, interactive=False)
    if plotter.iren is None or not plotter.iren.initialized:
        pytest.skip("no interaction without a window")
    before = splatvol_pyvista.add_volume(plotter, ball_file, opaque_scene()).update()
    press, move = plotter.iren._mouse_left_button_press, plotter.iren._mouse_move
    press(100, 80)
    move(130, 90)
    plotter.iren._mouse_left_button_release(130, 90)
    shown = np.asarray(plotter.screenshot(return_img=True))[..., :3]
    assert (shown != before).mean() > .02


def test_several_parts_are_refused(ball_file):
    plotter = pv.Plotter(off_screen=True, shape=(1, 2))
    plotter.show(auto_close=False)
    with pytest.raises(splatvol.UnsupportedError, match="several parts"):
        splatvol_pyvista.composite(plotter, ball_file)
    plotter.close()
