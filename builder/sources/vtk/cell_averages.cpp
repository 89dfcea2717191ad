#include "builder/sources/vtk/cell_averages.h"

#include <vtkCellType.h>
#include <vtkDataSet.h>
#include <vtkIdList.h>
#include <vtkNew.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "builder/sources/vtk/cells.h"

namespace splatvol {
namespace {

bool has_volume(vtkDataSet& data, vtkIdType cell) {
  const CellKind* kind = find_cell_kind(data.GetCellType(cell));
  return !kind || kind->role != CellRole::no_volume;
}

}  // namespace

bool is_surface(vtkDataSet& data) {
  bool area = false;
  for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
    if (has_volume(data, cell)) return false;
    area = area || data.GetCellType(cell) >= VTK_TRIANGLE;
  }
  return area;
}

CellCensus census_of(vtkDataSet& data) {
  CellCensus census;
  for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
    const CellKind* kind = find_cell_kind(data.GetCellType(cell));
    if (!kind) continue;
    ++census.cells[std::string(kind->name)];
    if (kind->role != CellRole::no_volume) continue;
    ++census.without_volume;
    census.lines += dimension_of(*kind) == 1 ? 1 : 0;
    census.surfaces += dimension_of(*kind) == 2 ? 1 : 0;
  }
  return census;
}

CellAverages::CellAverages(vtkDataSet& data, std::vector<double> volumes)
    : points_(static_cast<std::size_t>(data.GetNumberOfPoints())), weights_(std::move(volumes)) {
  const bool any_volume = std::ranges::any_of(weights_, [](double volume) { return volume > 0; });
  for (double& weight : weights_) weight = any_volume ? std::max(weight, 0.0) : weight < 0 ? 0 : 1;

  const vtkNew<vtkIdList> ids;
  begins_.push_back(0);
  for (std::size_t cell = 0; cell < weights_.size(); ++cell) {
    if (weights_[cell] > 0) data.GetCellPoints(static_cast<vtkIdType>(cell), ids);
    const auto first = static_cast<std::ptrdiff_t>(cell_points_.size());
    for (vtkIdType i = 0; weights_[cell] > 0 && i < ids->GetNumberOfIds(); ++i)
      if (const vtkIdType point = ids->GetId(i); point >= 0 && point < data.GetNumberOfPoints())
        cell_points_.push_back(static_cast<std::uint32_t>(point));
    // A collapsed cell names a point twice.
    std::sort(cell_points_.begin() + first, cell_points_.end());
    cell_points_.erase(std::unique(cell_points_.begin() + first, cell_points_.end()), cell_points_.end());
    begins_.push_back(cell_points_.size());
  }
}

std::vector<double> CellAverages::means(std::span<const double> values, std::vector<double>* weights) const {
  std::vector<double> sums(points_), means(points_, missing_value);
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
