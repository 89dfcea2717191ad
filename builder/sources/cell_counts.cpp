#include "builder/sources/cell_counts.h"

#include <string>

#include "builder/mesh/cell_kinds.h"

namespace splatvol {
namespace {

bool has_volume(const DataSet& data, std::uint64_t cell) {
  const CellKind* kind = find_cell_kind(data.cell_type(cell));
  return !kind || kind->role != CellRole::no_volume;
}

}  // namespace

bool is_surface(const DataSet& data) {
  bool area = false;
  for (std::uint64_t cell = 0; cell < data.cell_count(); ++cell) {
    if (has_volume(data, cell)) return false;
    area = area || data.cell_type(cell) >= vtk_cell::triangle;
  }
  return area;
}

CellCensus census_of(const DataSet& data) {
  CellCensus census;
  for (std::uint64_t cell = 0; cell < data.cell_count(); ++cell) {
    const CellKind* kind = find_cell_kind(data.cell_type(cell));
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
