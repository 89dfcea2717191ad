"""Scenes as dictionaries, in the layout of scene files (docs/scene.md)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Dict, Optional, Tuple, Union

from . import _core
from ._arguments import as_size
from .errors import FileError, InvalidArgumentError, InvalidDataError, MissingFileError

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
    except FileNotFoundError as error:
        raise MissingFileError(f"{path}: {error.strerror}") from error
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise InvalidDataError(f"{path}: {error}") from error


def refuse_both(scene: Optional[SceneLike], attribute: Optional[str]) -> None:
    """Raises an error if there is an attribute to show, and a scene, which has one itself."""
    if scene is not None and attribute is not None:
        raise InvalidArgumentError(
            f"attribute={attribute!r}: the scene says what to show: change scene['attribute'], or give no scene"
        )


def with_size(scene: Scene, size: Optional[Tuple[int, int]]) -> Scene:
    """Returns the scene with another size (width, height), if one is given."""
    if size is None:
        return scene
    width, height = as_size(size)
    return {**scene, "image": {"width": width, "height": height}}


def check_scene(scene: SceneLike) -> Scene:
    """Returns a scene with all of its fields. Raises an error that names the field that is missing or out of range."""
    return json.loads(_core.check_scene(json.dumps(read_scene(scene))))
