"""Shows a file: in a notebook, or in a window."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from typing import Any, Optional, Tuple

from ._files import File
from ._scenes import SceneLike, read_scene, refuse_both
from .errors import UnsupportedError


def show(
    file: File,
    scene: Optional[SceneLike] = None,
    size: Tuple[int, int] = (640, 480),
    *,
    attribute: Optional[str] = None,
) -> Any:
    """Shows a file. In a notebook, returns a widget whose picture is turned, moved and zoomed by the mouse. Elsewhere,
    starts the program ``svview`` and returns its process (``subprocess.Popen``).

    ``scene``: the first view; None: one that fits the data. ``attribute``: without a scene, what to show. ``size``:
    width and height of the widget, in pixels.

    Raises ``UnsupportedError`` if there is neither a notebook with anywidget nor an ``svview`` on PATH.
    """
    if _is_in_notebook():
        from .notebook import Viewer

        return Viewer(file, scene, size, attribute=attribute)
    refuse_both(scene, attribute)
    return _start_svview(file, scene if attribute is None else file.scene(attribute))


def _is_in_notebook() -> bool:
    if "IPython" not in sys.modules:
        return False
    shell = sys.modules["IPython"].get_ipython()
    return shell is not None and hasattr(shell, "kernel")


def _start_svview(file: File, scene: Optional[SceneLike]) -> "subprocess.Popen[bytes]":
    program = shutil.which("svview")
    if program is None:
        raise UnsupportedError(
            "there is no program svview on PATH, and this is no notebook: use File.render and save instead"
        )
    command = [program, file.path]
    if scene is not None:
        # Stays until the system clears its temporary files: svview may read it at any time.
        with tempfile.NamedTemporaryFile("w", suffix=".json", prefix="splatvol-", delete=False) as written:
            json.dump(read_scene(scene), written)
        command += ["--scene", written.name]
    process = subprocess.Popen(command)
    setattr(process, "file", file)  # of a mesh, the converted file goes with it
    return process
