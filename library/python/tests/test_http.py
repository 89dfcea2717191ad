"""Files on servers: on a web server that answers slowly, and by ssh."""

import http.server
import os
import re
import signal
import threading
import time

import numpy as np
import pytest

import splatvol


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    data = b""
    delay = 0.0
    asked: threading.Event    # a request came
    answers: threading.Event  # before it is set, no request has an answer

    def do_GET(self):
        time.sleep(self.delay)
        self.asked.set()
        self.answers.wait()
        asked = re.match(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        begin = int(asked[1]) if asked else 0
        end = min(int(asked[2]) + 1 if asked and asked[2] else len(self.data), len(self.data))
        self.send_response(206 if asked else 200)
        self.send_header("ETag", '"1"')
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(end - begin))
        if asked:
            self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{len(self.data)}")
        self.end_headers()
        self.wfile.write(self.data[begin:end])

    def do_HEAD(self):
        self.send_response(200)
        self.send_header("Content-Length", str(len(self.data)))
        self.send_header("Accept-Ranges", "bytes")
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture()
def address(large_path):
    """Serves a file. Skips the test on a system without libcurl."""

    class Serving(Handler):
        data = large_path.read_bytes()
        asked, answers = threading.Event(), threading.Event()

    Serving.answers.set()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Serving)
    server.handler = Serving
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    url = f"http://127.0.0.1:{server.server_port}/large.svol"
    try:
        splatvol.open(url)
        yield url, Serving
    except splatvol.FileError as error:
        if "libcurl" not in str(error):
            raise
        pytest.skip(str(error))
    finally:
        Serving.answers.set()
        server.shutdown()
        server.server_close()
        thread.join()


def test_frames_while_a_file_loads(address, large_path):
    url, serving = address
    file = splatvol.open(url)
    scene = file.scene(size=(200, 150))
    serving.delay = .05
    frames = list(file.frames(scene, tolerance=0, interval=.02))
    assert len(frames) > 2 and not frames[0].statistics.is_complete
    assert frames[-1].statistics.is_complete and frames[-1].statistics.missing_bytes == 0
    splats = [frame.statistics.splats for frame in frames]
    assert splats[0] < splats[-1]
    local = splatvol.open(large_path).render(scene, tolerance=0)
    np.testing.assert_allclose(frames[-1].picture, local, atol=1e-6)


def test_points_by_address(address, large_path):
    url, _ = address
    file = splatvol.open(url)
    np.testing.assert_array_equal(file.points(1).positions, splatvol.open(large_path).points(1).positions)
    assert 0 < file.bytes_read < file.file_bytes


def test_ctrl_c_ends_a_wait_for_a_server(address):
    url, serving = address
    file = splatvol.open(url)
    serving.asked.clear()
    serving.answers.clear()

    def interrupt():
        serving.asked.wait()
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        file.points()  # else it would last until ctest ends it
    thread.join()


def test_an_address_without_a_server():
    with pytest.raises(splatvol.FileError):
        splatvol.open("http://127.0.0.1:9/absent.svol")


def test_a_file_that_ssh_reaches(large_path, tmp_path, monkeypatch):
    server = "/usr/lib/openssh/sftp-server"
    if not os.access(server, os.X_OK):
        pytest.skip("no sftp-server on this machine (package openssh-sftp-server)")
    program = tmp_path / "ssh"
    program.write_text(f"#!/bin/sh\nexec {server}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    file = splatvol.open(f"ssh://me@host{large_path}")
    np.testing.assert_array_equal(file.points(1).positions, splatvol.open(large_path).points(1).positions)
    assert 0 < file.bytes_read < file.file_bytes
    with pytest.raises(splatvol.FileError, match="not found"):
        splatvol.open(f"ssh://host{large_path}.svol")


def test_a_mesh_on_a_server_is_built_there():
    for scheme in ("http", "https", "ssh"):
        with pytest.raises(splatvol.UnsupportedError, match="run svbuild there"):
            splatvol.open(f"{scheme}://host.invalid/mesh.vtu")
