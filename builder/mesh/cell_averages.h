// Values of cells as values at the points.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace splatvol {

/// Averages values of cells: a point gets the mean of the cells round it, each with its volume as weight.
class CellAverages {
 public:
  /// Appends the numbers of a cell's points; those that are out of range do not count.
  using PointsOf = std::function<void(std::size_t cell, std::vector<std::int64_t>& points)>;

  /// `volumes`: of each cell; negative: the cell does not count. If no cell has a volume, all cells that count have the
  /// same weight.
  CellAverages(std::size_t points, std::vector<double> volumes, const PointsOf& points_of);

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
