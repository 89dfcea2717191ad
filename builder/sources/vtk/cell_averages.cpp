#include "builder/sources/vtk/cell_averages.h"

#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/cells.h"

namespace splatvol {
namespace {

bool has_volume(vtkDataSet& data, vtkIdType cell) {
  const CellKind* kind = find_cell_kind(data.GetCellType(cell));
  return !kind || kind->role != CellRole::no_volume;
}

/// Averages arrays of the cells. Finds the cells that count once, for all arrays.
class CellAverages {
 public:
  explicit CellAverages(vtkDataSet& data) : data_(data) {
    const vtkIdType cells = data.GetNumberOfCells();
    bool volume = false;
    for (vtkIdType cell = 0; cell < cells && !volume; ++cell) volume = has_volume(data, cell);
    vtkUnsignedCharArray* ghosts = data.GetCellGhostArray();
    const bool whole_ghosts = ghosts && ghosts->GetNumberOfValues() >= cells;
    used_.resize(static_cast<std::size_t>(cells));
    for (vtkIdType cell = 0; cell < cells; ++cell) {
      const bool hidden = whole_ghosts && (ghosts->GetValue(cell) & vtkDataSetAttributes::HIDDENCELL) != 0;
      used_[static_cast<std::size_t>(cell)] = !hidden && (!volume || has_volume(data, cell));
    }
  }

  /// Returns the means at the points; NaN at points of no cell with a finite value.
  vtkSmartPointer<vtkDoubleArray> operator()(vtkDataArray& values) const {
    const int components = values.GetNumberOfComponents();
    auto means = vtkSmartPointer<vtkDoubleArray>::New();
    means->SetName(values.GetName());
    means->SetNumberOfComponents(components);
    means->SetNumberOfTuples(data_.GetNumberOfPoints());
    means->Fill(0);
    std::vector<std::uint32_t> counts(static_cast<std::size_t>(data_.GetNumberOfPoints()));
    for (int c = 0; c < components; ++c) average(values, c, *means, counts);
    return means;
  }

  /// Returns the sum of the weights of the cells round each point.
  [[nodiscard]] std::vector<double> weights() const {
    std::vector<double> sums(static_cast<std::size_t>(data_.GetNumberOfPoints()));
    const vtkNew<vtkIdList> points;
    for (vtkIdType cell = 0; cell < data_.GetNumberOfCells(); ++cell) {
      if (!used_[static_cast<std::size_t>(cell)]) continue;
      data_.GetCellPoints(cell, points);
      for (vtkIdType i = 0; i < points->GetNumberOfIds(); ++i)
        if (points->GetId(i) >= 0 && points->GetId(i) < data_.GetNumberOfPoints())
          ++sums[static_cast<std::size_t>(points->GetId(i))];
    }
    return sums;
  }

 private:
  void average(vtkDataArray& values, int component, vtkDoubleArray& means, std::vector<std::uint32_t>& counts) const {
    std::ranges::fill(counts, 0u);
    const vtkNew<vtkIdList> points;
    for (vtkIdType cell = 0; cell < data_.GetNumberOfCells(); ++cell) {
      const double value = values.GetComponent(cell, component);
      if (!used_[static_cast<std::size_t>(cell)] || !std::isfinite(value)) continue;
      data_.GetCellPoints(cell, points);
      for (vtkIdType i = 0; i < points->GetNumberOfIds(); ++i) {
        const vtkIdType point = points->GetId(i);
        if (point < 0 || point >= data_.GetNumberOfPoints()) continue;  // an error when the cells are split
        means.SetTypedComponent(point, component, means.GetTypedComponent(point, component) + value);
        ++counts[static_cast<std::size_t>(point)];
      }
    }
    for (vtkIdType point = 0; point < data_.GetNumberOfPoints(); ++point)
      means.SetTypedComponent(point, component,
                              means.GetTypedComponent(point, component) / counts[static_cast<std::size_t>(point)]);
  }

  vtkDataSet& data_;
  std::vector<bool> used_;  // [cell]: whether it counts
};

}  // namespace

bool is_surface(vtkDataSet& data) {
  bool area = false;
  for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
    if (has_volume(data, cell)) return false;
    area = area || data.GetCellType(cell) >= VTK_TRIANGLE;
  }
  return area;
}

std::vector<double> cell_weights(vtkDataSet& data) { return CellAverages(data).weights(); }

void average_cell_data(vtkDataSet& data, const std::vector<std::string>& selection) {
  vtkCellData& cells = *data.GetCellData();
  std::optional<CellAverages> averages;
  for (int i = 0; i < cells.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = cells.GetArray(i);
    if (!array || !cells.GetArrayName(i)) continue;
    const std::string name = cells.GetArrayName(i);
    if (is_bookkeeping(cells, i, name) || name == "HigherOrderDegrees" || !wants_array(selection, name)) continue;
    if (data.GetPointData()->HasArray(name.c_str()) || array->GetNumberOfTuples() < data.GetNumberOfCells()) continue;
    if (!averages) averages.emplace(data);
    data.GetPointData()->AddArray((*averages)(*array));
  }
}

}  // namespace splatvol
