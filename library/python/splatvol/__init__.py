"""Volumes of CFD and FEM results, on unstructured meshes and scattered points: built, read and drawn.

``build``, ``build_mesh`` and ``build_series`` make a .svol file, once. ``open`` opens one, from disk or from a web
server. See docs/python.md.
"""

from ._build import BuildReport, Step, build, build_mesh, build_series
from ._core import version as __version__
from ._files import (
    Attribute,
    File,
    Frame,
    Integral,
    LineSamples,
    Points,
    Streamline,
    SurfaceIntegral,
    SurfaceIntegrals,
    open,
)
from ._pictures import save, to_srgb8
from ._renderers import Statistics
from ._scenes import check_scene
from ._show import show
from .errors import (
    CancelledError,
    DeviceError,
    Error,
    FileError,
    InvalidArgumentError,
    InvalidDataError,
    MissingFileError,
    OutOfBudgetError,
    UnsupportedError,
)

__all__ = [
    "Attribute", "BuildReport", "CancelledError", "DeviceError", "Error", "File", "FileError", "Frame", "Integral",
    "InvalidArgumentError", "InvalidDataError", "LineSamples", "MissingFileError", "OutOfBudgetError", "Points",
    "Statistics", "Step", "Streamline", "SurfaceIntegral", "SurfaceIntegrals", "UnsupportedError", "__version__", "build",
    "build_mesh", "build_series", "check_scene", "open", "save", "show", "to_srgb8",
]
