import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import splatvol


def test_show_starts_svview(ball_file, tmp_path, monkeypatch):
    told = tmp_path / "told"
    program = tmp_path / "svview"
    program.write_text(f'#!/bin/sh\necho "$@" > {told}\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    assert splatvol.show(ball_file, ball_file.scene()).wait() == 0
    words = told.read_text().split()
    assert words[0] == ball_file.path and words[1] == "--scene" and splatvol.check_scene(words[2])
    assert splatvol.show(ball_file, attribute="U").wait() == 0
    assert splatvol.check_scene(told.read_text().split()[2])["attribute"] == "U"
    with pytest.raises(splatvol.InvalidArgumentError, match="the scene says"):
        splatvol.show(ball_file, ball_file.scene(), attribute="U")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(splatvol.UnsupportedError, match="svview"):
        splatvol.show(ball_file)


def test_the_package_imports_nothing_that_was_not_asked_for():
    code = "import sys, splatvol; print([m for m in ('anywidget', 'pyvista', 'vtkmodules', 'PIL') if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


@pytest.fixture()
def viewer(ball_file, monkeypatch):
    pytest.importorskip("anywidget")
    from splatvol.notebook import Viewer

    viewer = Viewer(ball_file, size=(160, 120))
    viewer.sent = []
    monkeypatch.setattr(Viewer, "send", lambda self, message, buffers=None: self.sent.append((message, buffers)))
    return viewer


def settle(viewer):
    for _ in range(100):
        viewer._on_message(viewer, {"kind": "rest"}, [])
        if viewer.sent[-1][0]["settled"]:
            return
    pytest.fail("no picture is the last one")


def test_the_widget_draws_turns_and_goes_back(viewer):
    settle(viewer)
    message, buffers = viewer.sent[-1]
    assert message["type"] == "image/png" and buffers[0].startswith(b"\x89PNG")
    first = buffers[0]
    before = viewer.scene["camera"]["position"]
    viewer._on_message(viewer, {"kind": "move", "turn": [.1, .05], "drag": [0, 0], "zoom": 1.2, "reset": False}, [])
    message, buffers = viewer.sent[-1]
    assert message["moving"] and not message["settled"] and buffers[0][:2] in (b"\xff\xd8", b"\x89P")
    assert not np.allclose(viewer.scene["camera"]["position"], before)
    viewer._on_message(viewer, {"kind": "move", "turn": [0, 0], "drag": [0, 0], "zoom": 1, "reset": True}, [])
    settle(viewer)
    assert viewer.sent[-1][1][0] == first


def test_the_widget_tells_errors(viewer):
    viewer._scene = {**viewer._scene, "attribute": "absent"}
    viewer._on_message(viewer, {"kind": "rest"}, [])
    assert viewer.sent[-1][0]["kind"] == "error" and "absent" in viewer.sent[-1][0]["text"]


def test_the_page_asks_for_one_picture_at_a_time(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node")
    shutil.copy(Path(splatvol.__file__).with_name("widget.js"), tmp_path / "widget.mjs")
    (tmp_path / "test.mjs").write_text("""
        import { Requests } from "./widget.mjs";
        const sent = [];
        const requests = new Requests({ send: (message) => sent.push(message) });
        requests.move((motion) => (motion.turn[0] += 1));
        requests.move((motion) => (motion.turn[0] += 2));
        requests.move((motion) => (motion.turn[0] += 3));
        requests.answered(false, true);
        requests.answered(false, true);
        setTimeout(() => console.log(JSON.stringify(sent.map((m) => [m.kind, m.turn ? m.turn[0] : 0]))), 400);
    """)
    told = subprocess.run([node, tmp_path / "test.mjs"], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == '[["move",1],["move",5],["rest",0]]'


def messages_until_idle(client, request):
    """Returns what a kernel publishes for a request."""
    messages = []
    while True:
        message = client.get_iopub_msg(timeout=60)
        if message["parent_header"].get("msg_id") != request:
            continue
        messages.append(message)
        if message["msg_type"] == "status" and message["content"]["execution_state"] == "idle":
            return messages


def test_the_widget_in_a_kernel(ball_path):
    """Plays the page of a notebook: asks for pictures, and turns."""
    for package in ("anywidget", "ipykernel"):
        pytest.importorskip(package)
    manager, client = pytest.importorskip("jupyter_client.manager").start_new_kernel(kernel_name="python3")
    try:
        code = f"import splatvol\nsplatvol.show(splatvol.open({str(ball_path)!r}), size=(80, 60))"
        shown = messages_until_idle(client, client.execute(code))
        data = [m["content"]["data"] for m in shown if m["msg_type"] == "execute_result"]
        assert data and "application/vnd.jupyter.widget-view+json" in data[0], shown
        comm = data[0]["application/vnd.jupyter.widget-view+json"]["model_id"]
        for content in [
            {"kind": "rest"},
            {"kind": "move", "turn": [.1, 0], "drag": [0, 0], "zoom": 1, "reset": False},
        ]:
            data = {"method": "custom", "content": content}
            message = client.session.msg("comm_msg", {"comm_id": comm, "data": data})
            client.shell_channel.send(message)
            answers = messages_until_idle(client, message["header"]["msg_id"])
            pictures = [m for m in answers if m["msg_type"] == "comm_msg" and m["buffers"]]
            assert len(pictures) == 1 and pictures[0]["content"]["data"]["content"]["kind"] == "picture"
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
