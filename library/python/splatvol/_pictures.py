"""Pictures: arrays (height, width, 4) of float32, linear and premultiplied."""

from __future__ import annotations

import os
import struct
import zlib
from typing import Mapping, Sequence, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from .errors import InvalidArgumentError


def _as_picture(picture: ArrayLike) -> NDArray[np.float32]:
    array = np.ascontiguousarray(picture, np.float32)
    if array.ndim != 3 or array.shape[2] != 4:
        raise InvalidArgumentError(f"a picture has the shape (height, width, 4), not {array.shape}")
    return array


def to_srgb8(picture: ArrayLike, background: Sequence[float] = (0, 0, 0)) -> NDArray[np.uint8]:
    """Returns the picture over a background as other programs show it: (height, width, 3), uint8, sRGB.

    ``picture``: as ``File.render`` returns it. ``background``: linear RGB.
    """
    array = _as_picture(picture)
    linear = array[..., :3] + (1 - array[..., 3:]) * np.asarray(background, np.float32)
    linear = np.clip(np.nan_to_num(linear), 0, 1)
    # Roots of two numbers of 8 bits are far apart beside the rounding of single precision.
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)
    return (srgb * 255 + 0.5).astype(np.uint8)


def save(
    path: Union[str, "os.PathLike[str]"],
    picture: ArrayLike,
    background: Sequence[float] = (0, 0, 0),
    *,
    transparent: bool = False,
    provenance: Mapping[str, str] = {},
) -> None:
    """Writes a picture to a ``.png`` (8 bits, over ``background``) or ``.exr`` file (32-bit float, as it is).

    ``background``: linear RGB. ``transparent``: a PNG keeps its alpha. ``provenance``: texts for the file's header.
    The file appears whole or not at all. Raises ``FileError`` if it cannot be written, and ``InvalidArgumentError`` for
    another extension.
    """
    red, green, blue = (float(channel) for channel in background)
    _core.write_picture(os.fsencode(path), _as_picture(picture), (red, green, blue), dict(provenance), transparent)


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Returns the bytes of a PNG file of pixels (height, width, 3)."""
    height, width, _ = pixels.shape
    # Each row begins with its filter: 0, none.
    rows = np.hstack([np.zeros((height, 1), np.uint8), pixels.reshape(height, 3 * width)])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) +
        chunk(b"IEND", b"")
    )
