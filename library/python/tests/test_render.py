import json
import subprocess

import numpy as np
import pytest

import splatvol


def constant_scene(size=(64, 64), density=0.5, projection="orthographic"):
    """A view along -z of a ball with one colour and one density."""
    return {
        "camera": {"projection": projection, "parallel_height": 3, "vertical_fov_degrees": 30,
                   "position": [0, 0, 10], "focal_point": [0, 0, 0], "up": [0, 1, 0]},
        "image": {"width": size[0], "height": size[1]},
        "background": [0, 0, 0],
        "attribute": "T",
        "transfer_function": {"domain": [-10, 10], "colors": [[0, 1, 0.5, 0.25]], "density": [[0, density]]},
    }


def test_a_homogeneous_ball(ball_file):
    picture = ball_file.render(constant_scene(), tolerance=0)
    assert picture.shape == (64, 64, 4) and picture.dtype == np.float32
    # The opacity on the axis is 1 - exp(-density * diameter). A lattice seen along an axis ripples by 2.5 %.
    assert picture[31:33, 31:33, 3].mean() == pytest.approx(1 - np.exp(-1), abs=.03)
    np.testing.assert_allclose(picture[..., 1], picture[..., 3] * .5, atol=1e-3)
    assert (picture[0, 0] == 0).all()
    assert ball_file.statistics.is_complete and ball_file.statistics.splats > 0


def test_row_0_is_at_the_top(ball_file):
    scene = constant_scene()
    scene["clip_box"] = {"low": [-2, 0, -2], "high": [2, 2, 2]}
    picture = ball_file.render(scene)
    assert picture[16:31, 32, 3].min() > .1 and picture[34:, :, 3].max() < .01


def test_sizes_and_scenes(ball_file, tmp_path):
    assert ball_file.render(size=(40, 30)).shape == (30, 40, 4)
    scene = ball_file.scene("U", size=(50, 20))
    assert scene["attribute"] == "U" and scene["image"] == {"width": 50, "height": 20}
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    np.testing.assert_array_equal(ball_file.render(path), ball_file.render(scene))
    assert ball_file.render(path, size=(10, 10)).shape == (10, 10, 4)
    assert splatvol.check_scene(scene)["attribute"] == "U"


def test_an_attribute_without_a_scene(ball_file):
    scene = ball_file.scene("U[1]", size=(40, 30))
    picture = ball_file.render(scene)
    np.testing.assert_array_equal(ball_file.render(attribute="U[1]", size=(40, 30)), picture)
    *_, last = ball_file.frames(attribute="U[1]", size=(40, 30), tolerance=0)
    np.testing.assert_allclose(last.picture, ball_file.render(scene, tolerance=0), atol=1e-6)
    assert (ball_file.render(attribute="T", size=(40, 30)) != picture).any()
    with pytest.raises(splatvol.InvalidArgumentError, match="attribute='T': the scene says what to show"):
        ball_file.render(scene, attribute="T")
    with pytest.raises(splatvol.InvalidArgumentError, match="no attribute"):
        ball_file.render(attribute="q")


def test_qualities(ball_file):
    scene = constant_scene()
    fine = ball_file.render(scene, tolerance=0)
    coarse = ball_file.render(scene, resolution=0)
    assert ball_file.statistics.splats == ball_file.resolution_counts[0]
    within = ball_file.render(scene, max_error=.05)
    assert np.sqrt(((within - fine)[..., :3] ** 2).mean()) < .1
    assert coarse.shape == ball_file.render(scene, splats=500).shape == ball_file.render(scene, milliseconds=500).shape
    for two in [dict(max_error=.1, splats=3), dict(milliseconds=9, splats=3)]:
        with pytest.raises(splatvol.InvalidArgumentError, match="give one of"):
            ball_file.render(scene, **two)


def test_seconds_are_deprecated(ball_file):
    with pytest.warns(DeprecationWarning, match="milliseconds"):
        assert ball_file.render(constant_scene(), seconds=.5).any()
    with pytest.warns(DeprecationWarning), pytest.raises(splatvol.InvalidArgumentError, match="give one of"):
        ball_file.render(constant_scene(), seconds=1, splats=3)


def test_pictures_of_few_cells_are_exact(ball_file):
    exact = ball_file.render(constant_scene(), exact=True)
    assert exact.any() and ball_file.statistics.splats == 0
    np.testing.assert_array_equal(ball_file.render(constant_scene()), exact)


def test_exact_pictures_need_cells(ball_file, ball_mesh, tmp_path):
    points, cells = ball_mesh
    assert splatvol.build(points, cells, {"T": points[:, 0]}, tmp_path / "a.svol", keep_cells=False).kept_cells == 0
    with pytest.raises(splatvol.InvalidArgumentError, match="--drop-cells"):
        splatvol.open(tmp_path / "a.svol").render(exact=True)
    with pytest.raises(splatvol.InvalidArgumentError, match="give one of"):
        ball_file.render(constant_scene(), exact=True, tolerance=0)
    with pytest.raises(splatvol.InvalidArgumentError, match="no frames"):
        next(iter(ball_file.frames(constant_scene(), exact=True)))
    with pytest.raises(splatvol.InvalidArgumentError, match="no frames"):
        next(iter(ball_file.frames(constant_scene(), milliseconds=9)))
    assert ball_file.render(constant_scene(), exact=False, tolerance=0).any()


def test_the_same_picture_as_svrender(ball_file, tmp_path, program):
    svrender, svdiff = program("svrender"), program("svdiff")
    scene = ball_file.scene("T", size=(160, 120))
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    options = ["--scene", tmp_path / "scene.json", "--device", "cpu", "--tolerance", "0", "-o", tmp_path / "a.exr"]
    subprocess.run([svrender, ball_file.path, *options], check=True, capture_output=True)
    splatvol.save(tmp_path / "b.exr", ball_file.render(scene, tolerance=0))
    told = subprocess.run([svdiff, tmp_path / "a.exr", tmp_path / "b.exr"], check=True, capture_output=True, text=True)
    numbers = [float(word) for word in told.stdout.replace(",", " ").split() if word[0].isdigit()]
    assert numbers and numbers[0] <= 1e-6, told.stdout


def test_errors_of_scenes(ball_file, tmp_path):
    scene = constant_scene()
    with pytest.raises(splatvol.Error, match="attribute"):
        ball_file.render({**scene, "attribute": "q"})
    with pytest.raises(splatvol.Error, match="colours|colors"):
        ball_file.render({**scene, "colours": []})
    with pytest.raises(splatvol.FileError, match="absent.json"):
        ball_file.render(tmp_path / "absent.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(splatvol.InvalidDataError, match="bad.json"):
        ball_file.render(tmp_path / "bad.json")
    # Calls that failed changed nothing.
    assert ball_file.render(scene).shape == (64, 64, 4)


def test_the_boundary_of_the_file_is_drawn(ball_mesh, ball_file, tmp_path):
    points, cells = ball_mesh
    splatvol.build(points, cells, {"T": points[:, 0]}, tmp_path / "a.svol", boundary_triangles=1000)
    scene = constant_scene()
    scene["surfaces"] = [{"boundary": "out*", "color": [0, 0, 1]}]
    file = splatvol.open(tmp_path / "a.svol")
    picture = file.render(scene)
    assert picture[32, 32, 3] == 1 and picture[32, 32, 2] > .9
    # The near side of the ball is open: its far side is seen through the volume.
    scene["surfaces"][0]["near_side"] = "hidden"
    opened = file.render(scene)
    assert opened[32, 32, 3] == 1 and opened[32, 32, 2] < picture[32, 32, 2]
    scene["surfaces"][0]["near_side"] = "open"
    with pytest.raises(splatvol.InvalidDataError, match="near_side: 'open' is none of shown, translucent and hidden"):
        file.render(scene)
    scene["surfaces"][0]["near_side"] = "shown"
    with pytest.raises(splatvol.InvalidArgumentError, match="--boundary"):
        ball_file.render(scene)


def test_surfaces_hide_what_lies_behind_them(ball_file):
    scene = constant_scene()
    half = np.full((64, 64), np.nan, np.float32)
    half[:, 32:] = 10  # the plane z = 0
    picture = ball_file.render(scene, tolerance=0, depths=half)
    assert picture[32, 30, 3] == pytest.approx(1 - np.exp(-1), abs=.03)
    assert picture[32, 34, 3] == pytest.approx(1 - np.exp(-.5), abs=.03)
    assert ball_file.render(scene, tolerance=0)[32, 34, 3] == pytest.approx(1 - np.exp(-1), abs=.03)
    with pytest.raises(splatvol.Error):
        ball_file.render(scene, depths=half[:3])
    with pytest.raises(splatvol.InvalidArgumentError, match="height"):
        ball_file.render(scene, depths=half[0])


def test_frames_end_in_the_complete_picture(ball_file):
    scene = constant_scene()
    frames = list(ball_file.frames(scene, tolerance=0))
    assert frames[-1].statistics.is_complete
    np.testing.assert_allclose(frames[-1].picture, ball_file.render(scene, tolerance=0), atol=1e-6)


def test_srgb_and_files(ball_file, tmp_path):
    picture = ball_file.render(constant_scene())
    pixels = splatvol.to_srgb8(picture, (1, 1, 1))
    assert pixels.shape == (64, 64, 3) and pixels.dtype == np.uint8 and (pixels[0, 0] == 255).all()
    assert (splatvol.to_srgb8(np.full((1, 1, 4), [.5, .2158605, 0, 1], np.float32)) == [188, 128, 0]).all()
    image = pytest.importorskip("PIL.Image")
    splatvol.save(tmp_path / "a.png", picture, (1, 1, 1), provenance={"scene": "{}"})
    np.testing.assert_allclose(np.asarray(image.open(tmp_path / "a.png").convert("RGB")).astype(int), pixels, atol=1)
    splatvol.save(tmp_path / "b.png", picture, transparent=True)
    assert image.open(tmp_path / "b.png").mode == "RGBA"
    with pytest.raises(splatvol.InvalidArgumentError):
        splatvol.save(tmp_path / "a.jpg", picture)
    with pytest.raises(splatvol.FileError):
        splatvol.save(tmp_path / "no" / "a.png", picture)
    with pytest.raises(splatvol.InvalidArgumentError, match="shape"):
        splatvol.save(tmp_path / "a.png", picture[..., :3])


def test_own_png_is_read_by_others(tmp_path):
    image = pytest.importorskip("PIL.Image")
    from splatvol._pictures import encode_png

    pixels = np.random.default_rng(0).integers(0, 256, (7, 5, 3), np.uint8)
    (tmp_path / "a.png").write_bytes(encode_png(pixels))
    np.testing.assert_array_equal(np.asarray(image.open(tmp_path / "a.png")), pixels)
