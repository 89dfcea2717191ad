// Arrays of the cells as values at the points.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/sources/source.h"

class vtkDataSet;

namespace splatvol {

/// Whether a data set has cells with an area, and none with a volume.
[[nodiscard]] bool is_surface(vtkDataSet& data);

/// Counts the cells of a data set, and those without volume.
[[nodiscard]] CellCensus census_of(vtkDataSet& data);

/// Averages arrays of the cells: a point gets the mean of the cells round it, each with its volume as weight.
class CellAverages {
 public:
  /// `volumes`: of each cell; negative: the cell does not count. If no cell has a volume, all cells that count have the
  /// same weight.
  CellAverages(vtkDataSet& data, std::vector<double> volumes);

  /// Returns the means of the cells' values at the points; cells whose value is not finite do not count. NaN at points
  /// of no cell that counts. Requires a value for each cell.
  /// `weights`: if not null, becomes the sum of the weights of the cells in each mean.
  [[nodiscard]] std::vector<double> means(std::span<const double> values, std::vector<double>* weights = nullptr) const;

 private:
  std::size_t points_;
  std::vector<double> weights_;             // [cell]; 0: does not count
  std::vector<std::uint64_t> begins_;       // [cell]: of its points; then the end of the last ones
  std::vector<std::uint32_t> cell_points_;  // each point of a cell once
};

}  // namespace splatvol
