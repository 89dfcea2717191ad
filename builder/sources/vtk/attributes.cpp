#include "builder/sources/vtk/attributes.h"

#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkInformation.h>
#include <vtkInformationStringKey.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSetGet.h>

#include <algorithm>

namespace splatvol {
namespace {

/// The arrays of the points, or of the cells, that give attributes.
std::vector<NamedArray> named_arrays(vtkDataSet& data, bool of_cells) {
  vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
  std::vector<NamedArray> named;
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    if (is_bookkeeping(arrays, i, name) || (of_cells && name == "HigherOrderDegrees")) continue;
    named.push_back({name, array->GetNumberOfComponents()});
  }
  return named;
}

}  // namespace

vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells) {
  return of_cells ? static_cast<vtkDataSetAttributes&>(*data.GetCellData()) : *data.GetPointData();
}

bool is_ghost_array(std::string_view name) { return name == "vtkGhostType" || name == "vtkGhostLevels"; }

bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name) {
  const int role = data.IsArrayAnAttribute(index);
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
}

bool wants_array(const std::vector<std::string>& selection, const std::string& array) {
  const auto is_array = [&](const std::string& name) {
    if (!name.starts_with(array)) return false;
    std::string_view rest = std::string_view(name).substr(array.size());
    for (const std::string_view suffix : {cells_suffix, points_suffix})
      if (rest.starts_with(suffix)) rest.remove_prefix(suffix.size());
    return rest.empty() || rest.starts_with("[");
  };
  return selection.empty() || std::ranges::any_of(selection, is_array);
}

Result<std::vector<ArrayAttribute>> attributes_of(const std::string& path, vtkDataSet& data, CellValues cells) {
  const std::vector<NamedArray> of_points = named_arrays(data, false), of_cells = named_arrays(data, true);
  SPLATVOL_TRY(check_attribute_count(path, of_points, of_cells));
  return attributes_of(of_points, of_cells, cells);
}

void add_missing(vtkDataSet& data, std::span<const ArrayShape> shapes, CellValues cells) {
  for (const ArrayShape& shape : shapes) {
    const bool of_cells = shape.of_cells.value_or(cells == CellValues::own);
    if (arrays_of(data, of_cells).HasArray(shape.name.c_str())) continue;
    const bool both = std::ranges::count(shapes, shape.name, &ArrayShape::name) > 1;
    if (!both && arrays_of(data, !of_cells).HasArray(shape.name.c_str())) continue;
    const vtkNew<vtkDoubleArray> array;
    array->SetName(shape.name.c_str());
    array->SetNumberOfComponents(shape.components);
    array->SetNumberOfTuples(of_cells ? data.GetNumberOfCells() : data.GetNumberOfPoints());
    array->Fill(missing_value);
    arrays_of(data, of_cells).AddArray(array);
  }
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

Result<VtkValues> find_values(const std::string& path, vtkDataSet& data, std::span<const ArrayAttribute> attributes,
                              std::size_t number) {
  const ArrayAttribute& attribute = attributes[number];
  const auto array_of = [&](bool of_cells) {
    vtkDataArray* array = arrays_of(data, of_cells).GetArray(attribute.array.c_str());
    return array && array->GetNumberOfComponents() == attribute.components ? array : nullptr;
  };
  VtkValues values{array_of(attribute.of_cells), attribute.of_cells};
  const auto other_taken = [&] {
    return std::ranges::any_of(attributes, [&](const ArrayAttribute& other) {
      return other.array == attribute.array && other.of_cells != attribute.of_cells;
    });
  };
  if (!values.array && !other_taken()) values = {array_of(!attribute.of_cells), !attribute.of_cells};
  if (!values.array)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" ({} components) of the first piece is not in this one",
                path, attribute.array, attribute.components);
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
