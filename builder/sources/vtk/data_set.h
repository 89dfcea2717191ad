// VTK's data sets as ours.
#pragma once

#include <memory>

#include "builder/sources/data_set.h"

class vtkDataSet;
class vtkDataSetAttributes;

namespace splatvol {

/// Returns a data set of ours that holds one of VTK's.
[[nodiscard]] std::unique_ptr<DataSet> data_set_of(vtkDataSet& data);

/// The same for a copy without its arrays, which the copy shares: a reader forgets its own data set at the next read.
[[nodiscard]] std::unique_ptr<DataSet> data_set_sharing_arrays(vtkDataSet& data);

/// The arrays of the cells of a data set, or of its points.
[[nodiscard]] vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells);

/// Makes the names of a data set's arrays UTF-8, by as_utf8 (base/printable.h).
void name_in_utf8(vtkDataSet& data);

}  // namespace splatvol
