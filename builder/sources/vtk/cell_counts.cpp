#include "builder/sources/vtk/cell_counts.h"

#include <vtkCellType.h>
#include <vtkDataSet.h>

#include <string>

#include "builder/mesh/cell_kinds.h"

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

}  // namespace splatvol
