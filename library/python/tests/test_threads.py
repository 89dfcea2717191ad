"""Other threads go on, and Ctrl-C ends calls."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import splatvol

SLOW = {"size": (1600, 1600), "max_error": 1e-9}


def count_during(call):
    """Returns how often a thread came to count while a call lasted, and the seconds that it took."""
    count, is_over = [0], threading.Event()

    def run():
        while not is_over.is_set():
            count[0] += 1
            time.sleep(.001)

    thread = threading.Thread(target=run)
    thread.start()
    start = time.perf_counter()
    call()
    seconds = time.perf_counter() - start
    is_over.set()
    thread.join()
    return count[0], seconds


@pytest.mark.parametrize("call", [
    lambda file, folder: file.render(size=(800, 800), tolerance=0),
    lambda file, folder: file.points(material=True),
    lambda file, folder: file.sample(np.random.default_rng(0).random((100_000, 3))),
    lambda file, folder: splatvol.build(
        np.random.default_rng(0).random((60_000, 3)), None, {"v": np.arange(60_000.)}, folder / "a.svol"),
], ids=["render", "points", "sample", "build"])
def test_the_gil_is_released(large_path, tmp_path, call):
    file = splatvol.open(large_path)
    count, seconds = count_during(lambda: call(file, tmp_path))
    # Each pause of a thousandth takes a few, on a machine whose processors are busy.
    assert count > 20 * seconds, (count, seconds)


def interrupt(call, after=.3):
    """Returns the seconds from Ctrl-C until a call has ended."""
    sent = []

    def send():
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        call()
        timer.cancel()
        pytest.fail("the call ended before Ctrl-C")
    return time.perf_counter() - sent[0]


def test_ctrl_c_ends_a_picture(large_path):
    file = splatvol.open(large_path)
    scene = file.scene()
    assert interrupt(lambda: file.render(scene, **SLOW)) < 2
    # The file can be used again.
    assert file.render(scene, size=(20, 20)).shape == (20, 20, 4)


def test_ctrl_c_ends_reads(large_path):
    file = splatvol.open(large_path)
    positions = np.random.default_rng(0).random((3_000_000, 3))
    assert interrupt(lambda: file.sample(positions)) < 3
    assert len(file.points(0).positions) > 0


@pytest.mark.parametrize("connectivity, count, after", [
    ("boxes", 3_000_000, .5), ("none", 500_000, 1), ("delaunay", 1_000_000, 2), ("delaunay", 2_000_000, 4),
])
def test_ctrl_c_ends_a_build_and_leaves_nothing(tmp_path, connectivity, count, after):
    points = np.random.default_rng(0).random((count, 3))
    values = {"v": points[:, 0].copy()}
    path = tmp_path / "a.svol"
    interrupt(lambda: splatvol.build(points, None, values, path, connectivity=connectivity), after)
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
        signal.setitimer(signal.ITIMER_REAL, .3)
        with pytest.raises(Late):
            splatvol.open(large_path).render(**SLOW)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
