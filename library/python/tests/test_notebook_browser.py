"""A notebook in JupyterLab, in Chromium without a display: the mouse turns and moves the picture."""

from __future__ import annotations

import io
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest

sync_api = pytest.importorskip("playwright.sync_api")
Image = pytest.importorskip("PIL.Image")
for package in ("anywidget", "jupyterlab"):
    pytest.importorskip(package)

PICTURE = ".jp-OutputArea img"


def free_port() -> int:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]


def notebook(path) -> dict:
    code = f"import splatvol\nsplatvol.show(splatvol.open({str(path)!r}), size=(240, 180))"
    cell = {"id": "a", "cell_type": "code", "source": code, "metadata": {}, "outputs": [], "execution_count": None}
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {"cells": [cell], "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


@pytest.fixture()
def address(ball_path, tmp_path):
    """The address of a notebook that shows a ball, on a server of its own."""
    (tmp_path / "view.ipynb").write_text(json.dumps(notebook(ball_path)))
    port = free_port()
    options = [f"--ServerApp.port={port}", "--ServerApp.port_retries=0", "--ServerApp.ip=127.0.0.1",
               f"--ServerApp.root_dir={tmp_path}", "--IdentityProvider.token=test"]
    environment = {**os.environ, "JUPYTER_CONFIG_DIR": str(tmp_path / "config")}
    with open(tmp_path / "server.log", "wb") as log:
        server = subprocess.Popen([sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", *options],
                                  env=environment, stdout=log, stderr=log)
    try:
        for _ in range(300):
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/api")
                break
            except OSError:
                assert server.poll() is None, (tmp_path / "server.log").read_text()
                time.sleep(.2)
        yield f"http://127.0.0.1:{port}/lab/tree/view.ipynb?token=test"
    finally:
        server.terminate()
        server.wait()


@pytest.fixture()
def page():
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no chromium")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 900, "height": 700})
        page.set_default_timeout(60_000)
        yield page
        browser.close()


def shown(page):
    """Returns the type of the picture's file, and the picture: (height, width, 3)."""
    type_, data = page.evaluate("""async (picture) => {
        const blob = await (await fetch(document.querySelector(picture).src)).blob();
        return [blob.type, Array.from(new Uint8Array(await blob.arrayBuffer()))];
    }""", PICTURE)
    return type_, np.asarray(Image.open(io.BytesIO(bytes(data))).convert("RGB"), np.float64)


def settled(page):
    """Waits for the picture of a mouse at rest. It is PNG; those on the way are JPEG."""
    for _ in range(300):
        if page.get_attribute(PICTURE, "src"):
            type_, picture = shown(page)
            if type_ == "image/png":
                return picture
        page.wait_for_timeout(100)
    pytest.fail("no picture is the last one")


def centre(picture) -> np.ndarray:
    """Returns the brightness's centre: x, y."""
    weights = picture.sum(axis=2)
    y, x = np.indices(weights.shape)
    return np.array([(x * weights).sum(), (y * weights).sum()]) / weights.sum()


def drag(page, x, y, button):
    """Drags from the picture's middle, by pixels. Returns what is shown before the button is up."""
    box = page.query_selector(PICTURE).bounding_box()
    from_x, from_y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(from_x, from_y)
    page.mouse.down(button=button)
    page.mouse.move(from_x + x, from_y + y, steps=10)
    page.wait_for_function("old => document.querySelector('.jp-OutputArea img').src !== old",
                           arg=page.get_attribute(PICTURE, "src"))
    on_the_way = shown(page)
    page.mouse.up(button=button)
    return on_the_way


def test_the_mouse_turns_and_moves_the_picture(address, page):
    errors = []
    page.on("pageerror", lambda error: errors.append(error))
    page.goto(address)
    page.click(".jp-Notebook .cm-content")
    page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]")
    page.keyboard.press("Shift+Enter")
    page.wait_for_selector(PICTURE)
    first = settled(page)
    assert first.shape == (180, 240, 3) and first.max() > 100

    type_, turning = drag(page, 60, 20, "left")
    assert type_ == "image/jpeg" and np.abs(turning - first).mean() > 1
    turned = settled(page)
    assert np.abs(turned - first).mean() > 1

    drag(page, 40, 10, "right")
    moved = settled(page)
    assert page.query_selector(".lm-Menu") is None, "a menu covers the picture"
    np.testing.assert_allclose(centre(moved) - centre(turned), (40, 10), atol=4)

    page.dblclick(PICTURE)
    page.wait_for_timeout(500)
    np.testing.assert_array_equal(settled(page), first)
    assert not errors
