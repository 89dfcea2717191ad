// Arrays of the cells as arrays of the points.
#pragma once

#include <string>
#include <vector>

class vtkDataSet;

namespace splatvol {

/// Whether a data set has cells with an area, and none with a volume.
[[nodiscard]] bool is_surface(vtkDataSet& data);

/// Adds an array of the points for each selected array of the cells. A point gets the mean of the finite values of the
/// cells round it, or NaN if there are none. Hidden cells do not count; if there are cells with a volume, only these
/// count. An array of the points takes precedence over an array of the cells with the same name.
void average_cell_data(vtkDataSet& data, const std::vector<std::string>& selection);

/// The weight of each point's means: the sum of the weights of the cells round it that count in average_cell_data().
[[nodiscard]] std::vector<double> cell_weights(vtkDataSet& data);

}  // namespace splatvol
