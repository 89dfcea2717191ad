"""A plugin of ParaView that opens .svol files: points of a resolution that fits a budget, with their attributes.

Tools > Manage Plugins > Load New... > SplatvolReader.py. ParaView's Python must find the package splatvol: start
ParaView with PYTHONPATH=FOLDER, where FOLDER is filled by `pip install --target FOLDER splatvol-*.whl`.
"""

import numpy as np
import splatvol
from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty, smproxy
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkDataArraySelection, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline


def _poly_data(points):
    """Returns points of splatvol as data of VTK. Arrays are shared, not copied."""
    output = vtkPolyData()
    positions = vtkPoints()
    positions.SetData(numpy_to_vtk(points.positions))
    output.SetPoints(positions)
    count = len(points.positions)
    vertices = vtkCellArray()
    vertices.SetData(numpy_to_vtkIdTypeArray(np.arange(count + 1)), numpy_to_vtkIdTypeArray(np.arange(count)))
    output.SetVerts(vertices)
    for name, values in points.values.items():
        array = numpy_to_vtk(values)
        array.SetName(name)
        output.GetPointData().AddArray(array)
    return output


@smproxy.reader(
    name="SplatvolReader", label="splatvol", extensions="svol svols", file_description="splatvol volumes"
)
class SplatvolReader(VTKPythonAlgorithmBase):
    """Reads points of a .svol file, or of an index of files (.svols). Its steps are ParaView's time steps."""

    def __init__(self):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkPolyData")
        self._name = None
        self._file = None
        self._resolution = -1
        self._max_points = 1_000_000
        self._uses_box = False
        self._box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
        self._attributes = vtkDataArraySelection()
        self._attributes.AddObserver("ModifiedEvent", lambda *_: self.Modified())

    def _change(self, name, value):
        if getattr(self, name) != value:
            setattr(self, name, value)
            self.Modified()

    @smproperty.stringvector(name="FileName")
    @smdomain.filelist()
    @smhint.filechooser(extensions=["svol", "svols"], file_description="splatvol volumes")
    def SetFileName(self, name):
        if name != self._name:
            self._file = None
        self._change("_name", name)

    @smproperty.intvector(name="Resolution", default_values=-1)
    def SetResolution(self, resolution):
        """0 is the coarsest; -1: the finest of up to Max Points."""
        self._change("_resolution", resolution)

    @smproperty.intvector(name="MaxPoints", default_values=1_000_000)
    @smdomain.intrange(min=1, max=2_000_000_000)
    def SetMaxPoints(self, max_points):
        self._change("_max_points", max_points)

    @smproperty.intvector(name="UseBox", default_values=0)
    @smdomain.xml('<BooleanDomain name="bool"/>')
    def SetUseBox(self, uses_box):
        """Whether points outside of the box are left out; their parts of the file are not read."""
        self._change("_uses_box", bool(uses_box))

    @smproperty.doublevector(name="BoxLow", default_values=[0, 0, 0])
    def SetBoxLow(self, x, y, z):
        self._change("_box", [[x, y, z], self._box[1]])

    @smproperty.doublevector(name="BoxHigh", default_values=[1, 1, 1])
    def SetBoxHigh(self, x, y, z):
        self._change("_box", [self._box[0], [x, y, z]])

    @smproperty.doublevector(name="TimestepValues", information_only="1", si_class="vtkSITimeStepsProperty")
    def GetTimestepValues(self):
        return self._open().times if self._name else None

    @smproperty.dataarrayselection(name="Attributes")
    def GetDataArraySelection(self):
        return self._attributes

    def _open(self):
        if self._file is None:
            self._file = splatvol.open(self._name)
            for attribute in self._file.attributes:
                self._attributes.AddArray(attribute.name)
        return self._file

    def RequestInformation(self, request, inputs, outputs):
        times = self._open().times
        information = outputs.GetInformationObject(0)
        pipeline = vtkStreamingDemandDrivenPipeline
        information.Remove(pipeline.TIME_STEPS())
        information.Remove(pipeline.TIME_RANGE())
        for time in times:
            information.Append(pipeline.TIME_STEPS(), time)
        if times:
            information.Append(pipeline.TIME_RANGE(), times[0])
            information.Append(pipeline.TIME_RANGE(), times[-1])
        return 1

    def RequestData(self, request, inputs, outputs):
        file = self._open()
        information = outputs.GetInformationObject(0)
        self._show_time(information)
        names = [a.name for a in file.attributes if self._attributes.ArrayIsEnabled(a.name)]
        resolution = self._resolution if self._resolution >= 0 else None
        box = self._box if self._uses_box else None
        # The file reads all attributes if it is given none.
        points = file.points(resolution, self._max_points, box, names or [file.attributes[0].name])
        vtkPolyData.GetData(information).ShallowCopy(_poly_data(points))
        return 1

    def _show_time(self, information):
        """Shows the last step that is not later than the time that is asked for."""
        update_time = vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()
        times = self._file.times
        if not times or not information.Has(update_time):
            return
        before = np.searchsorted(times, information.Get(update_time), side="right")
        step = max(int(before) - 1, 0)
        if step != self._file.step:
            self._file.show_step(step)
