#include "builder/sources/vtk/attributes.h"

#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkInformation.h>
#include <vtkInformationStringKey.h>
#include <vtkPointData.h>
#include <vtkSetGet.h>

#include <algorithm>

#include "base/printable.h"

namespace splatvol {
namespace {

/// Adds the arrays of the points, or of the cells, that give attributes.
void add_shapes(vtkDataSet& data, bool of_cells, std::vector<ArrayShape>& shapes) {
  vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    if (!is_bookkeeping(arrays, i, name)) shapes.push_back({name, array->GetNumberOfComponents(), of_cells});
  }
}

}  // namespace

vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells) {
  return of_cells ? static_cast<vtkDataSetAttributes&>(*data.GetCellData()) : *data.GetPointData();
}

bool is_ghost_array(std::string_view name) { return name == "vtkGhostType" || name == "vtkGhostLevels"; }

bool is_bookkeeping(std::string_view name) {
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         name == "HigherOrderDegrees";
}

bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name) {
  const int role = data.IsArrayAnAttribute(index);
  return is_bookkeeping(name) || role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
}

void name_in_utf8(vtkDataSet& data) {
  for (const bool of_cells : {false, true}) {
    vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i)
      if (const char* name = arrays.GetArrayName(i)) arrays.GetAbstractArray(i)->SetName(as_utf8(name).c_str());
  }
}

std::vector<ArrayShape> array_shapes(vtkDataSet& data) {
  std::vector<ArrayShape> shapes;
  for (const bool of_cells : {false, true}) add_shapes(data, of_cells, shapes);
  return shapes;
}

std::string unit_label(vtkDataSet& data, const std::string& array) {
  for (vtkDataSetAttributes* arrays :
       std::initializer_list<vtkDataSetAttributes*>{data.GetPointData(), data.GetCellData()}) {
    vtkAbstractArray* found = arrays->GetAbstractArray(array.c_str());
    if (found && found->HasInformation() && found->GetInformation()->Has(vtkDataArray::UNITS_LABEL()))
      return found->GetInformation()->Get(vtkDataArray::UNITS_LABEL());
  }
  return {};
}

Result<VtkValues> find_values(const std::string& path, vtkDataSet& data, const ArrayAttribute& attribute) {
  const auto has = [&](bool of_cells) { return arrays_of(data, of_cells).HasArray(attribute.array.c_str()) != 0; };
  const bool of_cells = attribute.of_cells != (!has(attribute.of_cells) && !attribute.has_twin);
  if (!has(of_cells)) return VtkValues{nullptr, attribute.of_cells};
  const VtkValues values{arrays_of(data, of_cells).GetArray(attribute.array.c_str()), of_cells};
  if (!values.array)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" holds texts here, and numbers elsewhere", path,
                attribute.array);
  if (values.array->GetNumberOfComponents() != attribute.components)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} components here, and {} elsewhere", path,
                attribute.array, values.array->GetNumberOfComponents(), attribute.components);
  const vtkIdType expected = values.of_cells ? data.GetNumberOfCells() : data.GetNumberOfPoints();
  if (values.array->GetNumberOfTuples() < expected)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} {}", path, attribute.array,
                values.array->GetNumberOfTuples(), expected, values.of_cells ? "cells" : "points");
  return values;
}

void read_component(vtkDataArray& array, int component, std::span<const std::uint32_t> indices,
                    std::span<double> values) {
  const auto read = [&](const auto* data) {
    const auto stride = static_cast<std::size_t>(array.GetNumberOfComponents());
    data += component;
    for (std::size_t i = 0; i < indices.size(); ++i) values[i] = static_cast<double>(data[indices[i] * stride]);
  };
  if (array.HasStandardMemoryLayout()) {
    const void* data = array.GetVoidPointer(0);
    switch (array.GetDataType()) { vtkTemplateMacro(return read(static_cast<const VTK_TT*>(data))); }
  }
  for (std::size_t i = 0; i < indices.size(); ++i) values[i] = array.GetComponent(indices[i], component);
}

std::vector<double> component_values(vtkDataArray& array, int component, std::span<const std::uint32_t> indices) {
  std::vector<double> values(indices.size());
  read_component(array, component, indices, values);
  return values;
}

}  // namespace splatvol
