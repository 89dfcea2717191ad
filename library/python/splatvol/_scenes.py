"""Scenes as dictionaries, in the layout of scene files (docs/scene.md)."""

from __future__ import annotations

import json
import operator
import os
from pathlib import Path
from typing import Any, Dict, Optional, Tuple, Union

from . import _core
from .errors import FileError, InvalidDataError

Scene = Dict[str, Any]
SceneLike = Union[Scene, str, "os.PathLike[str]"]


def read_scene(scene: SceneLike) -> Scene:
    """Returns a scene that is not shared with the caller.

    ``scene``: a dictionary, or the path of a scene file. Raises ``FileError`` if the file cannot be read, and
    ``InvalidDataError`` if it is no JSON. The fields are checked when it is drawn.
    """
    if isinstance(scene, dict):
        return json.loads(json.dumps(scene))
    path = Path(scene)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise InvalidDataError(f"{path}: {error}") from error


def with_size(scene: Scene, size: Optional[Tuple[int, int]]) -> Scene:
    """Returns the scene with another size (width, height), if one is given."""
    if size is None:
        return scene
    width, height = size
    return {**scene, "image": {"width": operator.index(width), "height": operator.index(height)}}


def check_scene(scene: SceneLike) -> Scene:
    """Returns a scene with all of its fields. Raises an error that names the field that is missing or out of range."""
    return json.loads(_core.check_scene(json.dumps(read_scene(scene))))
