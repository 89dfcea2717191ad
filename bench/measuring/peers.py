"""Draws a scene by VTK's unstructured volume mappers, which are a user's choice today.

Every view gets a process of its own, so that a fault in VTK or its driver ends with a message here."""

import json
import re
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from .common import Failure
from .pictures import write_exr

KINDS = {"projected-tets": "vtkProjectedTetrahedraMapper", "ray-cast": "vtkUnstructuredGridVolumeRayCastMapper"}


class PeerError(Failure):
    """The process of a peer ended before its answer. Its message is on stderr."""


class Peers:
    """A process that holds one view: its mesh and, once drawn, a window for each kind of mapper."""

    def __init__(self, mesh, scene):
        self._process = ProcessPoolExecutor(1, get_context("spawn"), _load, (str(mesh), str(scene)))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.shutdown()

    def prepare(self, kind, picture):
        """Draws the first frame and writes it as EXR. Returns {"cells", "first_image_seconds", "version"}."""
        return self._ask(_prepare, kind, str(picture))

    def frames(self, kind, count):
        """Draws `count` further frames and returns the seconds of each. The camera moves a tiny bit, so that cells are
        sorted again."""
        return self._ask(_frames, kind, count)

    def _ask(self, function, kind, *arguments):
        try:
            return self._process.submit(function, kind, *arguments).result()
        except BrokenProcessPool as error:
            raise PeerError(f"{KINDS[kind]}: its process died (--without peers goes on without)") from error


# In the child process: the view, and its windows by kind.
_view = {}


def _load(mesh, scene_path):
    import vtk

    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_ERROR)
    with open(scene_path) as file:
        scene = json.load(file)
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(mesh)
    tetrahedra = vtk.vtkDataSetTriangleFilter()
    tetrahedra.SetInputConnection(reader.GetOutputPort())
    tetrahedra.TetrahedraOnlyOn()
    tetrahedra.Update()
    grid = tetrahedra.GetOutput()
    _activate(grid, scene["attribute"])
    _view.update(scene=scene, grid=grid, property=_property(scene["transfer_function"]), windows={})


def _activate(grid, attribute):
    """Makes the attribute the grid's scalars: an array, a vector's magnitude, or NAME[i]. Missing values become 0."""
    import numpy
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    name, component = re.fullmatch(r"(.*?)(?:\[(\d+)\])?", attribute).groups()
    values = vtk_to_numpy(grid.GetPointData().GetArray(name)).astype(numpy.float32)
    if component is not None:
        values = values[:, int(component)]
    elif values.ndim == 2:
        values = numpy.linalg.norm(values, axis=1)
    scalars = numpy_to_vtk(numpy.nan_to_num(values), deep=True)
    scalars.SetName("svbench")
    grid.GetPointData().SetScalars(scalars)


def _property(transfer_function):
    """Makes VTK's transfer function. Opacities must lie in [0, 1], so densities are divided by the largest one. The
    inverse of that is the unit of length."""
    import vtk

    if transfer_function.get("axis", "linear") != "linear":
        raise ValueError("VTK's transfer functions are compared on linear axes only")
    low, high = transfer_function["domain"]
    densest = max(density for _, density in transfer_function["density"]) or 1.0
    colors, opacities = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for t, *rgb in transfer_function["colors"]:
        colors.AddRGBPoint(low + t * (high - low), *rgb)
    for t, density in transfer_function["density"]:
        opacities.AddPoint(low + t * (high - low), density / densest)
    properties = vtk.vtkVolumeProperty()
    properties.SetColor(colors)
    properties.SetScalarOpacity(opacities)
    properties.SetScalarOpacityUnitDistance(1 / densest)
    properties.SetInterpolationTypeToLinear()
    properties.ShadeOff()
    return properties


def _mapper(kind, grid):
    import vtk

    mapper = getattr(vtk, KINDS[kind])()
    mapper.SetInputData(grid)
    if kind == "ray-cast":  # a ray for every pixel
        mapper.AutoAdjustSampleDistancesOff()
        mapper.SetImageSampleDistance(1)
    return mapper


def _place_camera(camera, description):
    camera.SetPosition(description["position"])
    camera.SetFocalPoint(description["focal_point"])
    camera.SetViewUp(description["up"])
    if description.get("projection") == "orthographic":
        camera.ParallelProjectionOn()
        camera.SetParallelScale(description["parallel_height"] / 2)
    else:
        camera.SetViewAngle(description["vertical_fov_degrees"])


def _window(kind):
    import vtk

    volume = vtk.vtkVolume()
    volume.SetMapper(_mapper(kind, _view["grid"]))
    volume.SetProperty(_view["property"])
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    renderer.SetBackgroundAlpha(0)
    renderer.AddVolume(volume)
    window = vtk.vtkRenderWindow()
    window.OffScreenRenderingOn()
    window.SetMultiSamples(0)
    window.AlphaBitPlanesOn()
    window.SetSize(_view["scene"]["image"]["width"], _view["scene"]["image"]["height"])
    window.AddRenderer(renderer)
    _place_camera(renderer.GetActiveCamera(), _view["scene"]["camera"])
    renderer.ResetCameraClippingRange()
    return window


def _render(window):
    start = time.perf_counter()
    window.Render()
    window.WaitForCompletion()
    return time.perf_counter() - start


def _rgba(window):
    """Returns the window's pixels, 8 bits a channel: linear, as nothing in between applies a curve."""
    import vtk
    from vtkmodules.util.numpy_support import vtk_to_numpy

    grabber = vtk.vtkWindowToImageFilter()
    grabber.SetInput(window)
    grabber.SetInputBufferTypeToRGBA()
    grabber.ReadFrontBufferOff()
    grabber.Update()
    width, height, _ = grabber.GetOutput().GetDimensions()
    return vtk_to_numpy(grabber.GetOutput().GetPointData().GetScalars()).reshape(height, width, 4)[::-1] / 255


def _prepare(kind, picture):
    import vtk

    start = time.perf_counter()
    window = _view["windows"][kind] = _window(kind)
    _render(window)
    rgba = _rgba(window)
    seconds = time.perf_counter() - start
    write_exr(picture, rgba)
    return {
        "cells": _view["grid"].GetNumberOfCells(),
        "first_image_seconds": seconds,
        "version": vtk.vtkVersion.GetVTKVersion(),
    }


def _frames(kind, count):
    window = _view["windows"][kind]
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    seconds = []
    for _ in range(count):
        camera.Azimuth(1e-4)
        seconds.append(_render(window))
    return seconds
