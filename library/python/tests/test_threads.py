"""Other threads go on, and Ctrl-C ends calls."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import splatvol

SLOW = {"size": (1600, 1600), "max_error": 1e-9}


def turns_during(call, action=None):
    """Returns how many turns another thread had while a call lasted. After 20 of them it runs an action."""
    turns, begins, is_over = [0], threading.Event(), threading.Event()

    def run():
        begins.wait()
        while not is_over.is_set():
            turns[0] += 1
            if turns[0] == 20 and action:
                action()
            time.sleep(.001)  # it gives its turn away

    thread = threading.Thread(target=run)
    thread.start()
    begins.set()
    try:
        call()
    finally:
        is_over.set()
        thread.join()
    return turns[0]


@pytest.mark.parametrize("call", [
    lambda file, folder: file.render(size=(800, 800), tolerance=0),
    lambda file, folder: file.points(material=True),
    lambda file, folder: file.sample(np.random.default_rng(0).random((100_000, 3))),
    lambda file, folder: splatvol.build(
        np.random.default_rng(0).random((60_000, 3)), None, {"v": np.arange(60_000.)}, folder / "a.svol"),
], ids=["render", "points", "sample", "build"])
def test_the_gil_is_released(large_path, tmp_path, call):
    file = splatvol.open(large_path)
    # A call that held the GIL would leave a turn or two, before and after it. A busy machine leaves few now and then.
    assert any(turns_during(lambda: call(file, tmp_path)) > 5 for _ in range(10))


def send(number):
    os.kill(os.getpid(), number)


def work_of(call, raises=None):
    """Returns the seconds of processors that a call takes: they do not grow where others use the machine, too."""
    start = time.process_time()
    if raises is None:
        call()
    else:
        with pytest.raises(raises):
            call()
            pytest.fail("the call ended before its signal")
    return time.process_time() - start


def interrupted(call):
    """Makes a call that Ctrl-C interrupts, once it has begun."""
    return lambda: turns_during(call, lambda: send(signal.SIGINT))


def test_ctrl_c_ends_a_picture(large_path):
    file = splatvol.open(large_path)
    scene = file.scene()
    whole = work_of(lambda: file.render(scene, **SLOW))
    assert work_of(interrupted(lambda: file.render(scene, **SLOW)), KeyboardInterrupt) < whole / 2
    # The file can be used again.
    assert file.render(scene, size=(20, 20)).shape == (20, 20, 4)


def test_ctrl_c_ends_reads(large_path):
    file = splatvol.open(large_path)
    positions = np.random.default_rng(0).random((3_000_000, 3))
    whole = work_of(lambda: file.sample(positions))
    assert work_of(interrupted(lambda: file.sample(positions)), KeyboardInterrupt) < whole / 2
    assert len(file.points(0).positions) > 0


@pytest.mark.parametrize("connectivity, count, stage", [
    ("boxes", 3_000_000, "reading"), ("none", 500_000, "writing"), ("delaunay", 500_000, "connecting"),
    ("delaunay", 500_000, "writing"),
])
def test_ctrl_c_ends_a_build_and_leaves_nothing(tmp_path, connectivity, count, stage):
    points = np.random.default_rng(0).random((count, 3))
    values = {"v": points[:, 0].copy()}
    told = []

    def progress(current, _):
        told.append(current)
        if current == stage:
            send(signal.SIGINT)

    path = tmp_path / "a.svol"
    with pytest.raises(KeyboardInterrupt):
        splatvol.build(points, None, values, path, connectivity=connectivity, progress=progress)
    assert told[-1] == stage
    assert list(tmp_path.iterdir()) == []  # a build that went on would have left the file


def test_threads_share_a_file(ball_path):
    file = splatvol.open(ball_path)
    expected = file.render(size=(64, 64))
    pictures = []
    threads = [threading.Thread(target=lambda: pictures.append(file.render(size=(64, 64)))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for picture in pictures:
        np.testing.assert_array_equal(picture, expected)


def test_a_timer_of_python_may_raise(large_path):
    class Late(Exception):
        pass

    def raise_late(*_):
        raise Late

    before = signal.signal(signal.SIGALRM, raise_late)
    try:
        file = splatvol.open(large_path)
        with pytest.raises(Late):
            turns_during(lambda: file.render(**SLOW), lambda: send(signal.SIGALRM))
    finally:
        signal.signal(signal.SIGALRM, before)
