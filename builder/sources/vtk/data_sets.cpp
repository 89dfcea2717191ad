#include "builder/sources/vtk/data_sets.h"

#include <vtkDataSet.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>

namespace splatvol {

vtkSmartPointer<vtkDataSet> copy_sharing_arrays(vtkDataSet& data) {
  vtkSmartPointer<vtkDataSet> copy;
  copy.TakeReference(data.NewInstance());
  copy->ShallowCopy(&data);
  return copy;
}

vtkSmartPointer<vtkPoints> make_points(std::span<const dvec3> points) {
  auto copy = vtkSmartPointer<vtkPoints>::New();
  copy->SetDataTypeToDouble();
  copy->SetNumberOfPoints(static_cast<vtkIdType>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) copy->SetPoint(static_cast<vtkIdType>(i), &points[i].x);
  return copy;
}

}  // namespace splatvol
