#include "builder/sources/vtk/loaded_data_sets.h"

namespace splatvol {

Result<vtkSmartPointer<vtkDataSet>> LoadedDataSets::next() {
  return next_ == data_.size() ? nullptr : std::exchange(data_[next_++], nullptr);
}

}  // namespace splatvol
