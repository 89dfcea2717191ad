#include "builder/sources/vtk/data_sets.h"

#include <vtkDataSet.h>
#include <vtkSmartPointer.h>

namespace splatvol {

vtkSmartPointer<vtkDataSet> copy_sharing_arrays(vtkDataSet& data) {
  vtkSmartPointer<vtkDataSet> copy;
  copy.TakeReference(data.NewInstance());
  copy->ShallowCopy(&data);
  return copy;
}

}  // namespace splatvol
