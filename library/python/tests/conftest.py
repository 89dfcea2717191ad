"""Meshes and files for the tests."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

import splatvol

# A script starts what it runs in the background with SIGINT ignored: tests of Ctrl-C would wait for ever.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The six tetrahedra of a cube, by its corners (bit 0: x, 1: y, 2: z).
_TETRAHEDRA = np.array([[0, a, a | b, 7] for a, b in [(1, 2), (2, 4), (4, 1), (1, 4), (2, 1), (4, 2)]])


def cube_corners(cells: int) -> np.ndarray:
    """Returns the point numbers of the corners of cells^3 cubes: (cells^3, 8)."""
    index = np.arange(cells)
    z, y, x = np.meshgrid(index, index, index, indexing="ij")
    side = cells + 1
    first = (x + side * (y + side * z)).reshape(-1, 1)
    offsets = [(bit & 1) + side * (bit >> 1 & 1) + side * side * (bit >> 2) for bit in range(8)]
    return first + np.array(offsets)


def lattice(cells: int) -> np.ndarray:
    """Returns the points of cells^3 cubes in [-1, 1]^3: (n, 3)."""
    x = np.linspace(-1, 1, cells + 1)
    grid = np.meshgrid(x, x, x, indexing="ij")
    return np.stack([grid[2], grid[1], grid[0]], axis=-1).reshape(-1, 3)


def hexahedra(cells: int) -> np.ndarray:
    """Returns the cubes in VTK's order of corners: (cells^3, 8)."""
    return cube_corners(cells)[:, [0, 1, 3, 2, 4, 5, 7, 6]]


def ball(cells: int) -> "tuple[np.ndarray, np.ndarray]":
    """Returns points and tetrahedra of a ball of radius 1."""
    points = lattice(cells)
    # Cubes round the origin become spheres.
    largest, length = np.abs(points).max(axis=1), np.linalg.norm(points, axis=1)
    points = points * np.divide(largest, length, out=np.zeros_like(length), where=length > 0)[:, None]
    return points, cube_corners(cells)[:, _TETRAHEDRA].reshape(-1, 4)


def linear(points: np.ndarray) -> np.ndarray:
    return 1 + points @ np.array([2.0, -1.0, 0.5])


@pytest.fixture(scope="session")
def ball_mesh():
    return ball(16)


@pytest.fixture(scope="session")
def ball_path(ball_mesh, tmp_path_factory) -> Path:
    points, cells = ball_mesh
    path = tmp_path_factory.mktemp("ball") / "ball.svol"
    velocity = np.stack([points[:, 1], -points[:, 0], 0 * points[:, 2]], axis=-1)
    splatvol.build(points, cells, {"T": linear(points), "U": velocity}, path, units={"T": "K"}, exact=True)
    return path


@pytest.fixture()
def ball_file(ball_path) -> splatvol.File:
    return splatvol.open(ball_path)


@pytest.fixture(scope="session")
def large_path(tmp_path_factory) -> Path:
    """A file whose picture takes seconds: scattered points, joined cheaply."""
    random = np.random.default_rng(1)
    points = random.random((400_000, 3), np.float32)
    path = tmp_path_factory.mktemp("large") / "large.svol"
    splatvol.build(points, None, {"v": np.sin(9 * points[:, 0])}, path, connectivity="boxes")
    return path


@pytest.fixture()
def program():
    """Finds a program of splatvol, in SPLATVOL_PROGRAMS or on PATH; skips the test if it is absent."""

    def find(name: str) -> str:
        found = shutil.which(name, path=os.environ.get("SPLATVOL_PROGRAMS")) or shutil.which(name)
        if found is None:
            pytest.skip(f"no program {name}: set SPLATVOL_PROGRAMS to their folder")
        return found

    return find


@pytest.fixture()
def series_path(tmp_path) -> Path:
    """A time series of two steps, at 0 and 1. The second has 1 more everywhere."""
    points, cells = ball(4)
    path = tmp_path / "series.svol"
    splatvol.build_series(points, cells, [(step, {"T": linear(points) + step}) for step in range(2)], path)
    return path
