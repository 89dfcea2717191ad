#include "builder/mesh/cell_averages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {

CellAverages::CellAverages(std::size_t points, std::vector<double> volumes, const PointsOf& points_of)
    : points_(points), weights_(std::move(volumes)) {
  const bool any_volume = std::ranges::any_of(weights_, [](double volume) { return volume > 0; });
  for (double& weight : weights_) weight = any_volume ? std::max(weight, 0.0) : weight < 0 ? 0 : 1;

  std::vector<std::int64_t> of_cell;
  begins_.push_back(0);
  for (std::size_t cell = 0; cell < weights_.size(); ++cell) {
    of_cell.clear();
    if (weights_[cell] > 0) points_of(cell, of_cell);
    const auto first = static_cast<std::ptrdiff_t>(cell_points_.size());
    for (const std::int64_t point : of_cell)
      if (point >= 0 && static_cast<std::size_t>(point) < points_)
        cell_points_.push_back(static_cast<std::uint32_t>(point));
    // A collapsed cell names a point twice.
    std::sort(cell_points_.begin() + first, cell_points_.end());
    cell_points_.erase(std::unique(cell_points_.begin() + first, cell_points_.end()), cell_points_.end());
    begins_.push_back(cell_points_.size());
  }
}

std::vector<double> CellAverages::means(std::span<const double> values, std::vector<double>* weights) const {
  std::vector<double> sums(points_), means(points_, std::numeric_limits<double>::quiet_NaN());
  for (std::size_t cell = 0; cell < weights_.size(); ++cell) {
    if (begins_[cell] == begins_[cell + 1]) continue;
    const double value = values[cell];
    if (!std::isfinite(value)) continue;
    for (std::uint64_t i = begins_[cell]; i < begins_[cell + 1]; ++i) {
      const std::uint32_t point = cell_points_[i];
      // So that a constant stays what it is.
      if (sums[point] == 0) means[point] = value;
      sums[point] += weights_[cell];
      means[point] += weights_[cell] / sums[point] * (value - means[point]);
    }
  }
  if (weights) *weights = std::move(sums);
  return means;
}

}  // namespace splatvol
