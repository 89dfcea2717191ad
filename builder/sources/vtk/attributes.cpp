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
#include <cmath>

namespace splatvol {
namespace {

/// Appends the attributes of one array: a number gives one, a vector its magnitude and components.
void append_array(const VtkAttribute& array, std::vector<VtkAttribute>& attributes) {
  attributes.push_back(array);
  if (array.components == 1) return;
  attributes.back().component = VtkAttribute::magnitude;
  for (int c = 0; c < array.components; ++c) {
    attributes.push_back(array);
    attributes.back().name = fmt::format("{}[{}]", array.name, c);
    attributes.back().component = c;
  }
}

/// Appends the attributes of the points' arrays, or of the cells'. `suffix`: for names that are taken already.
void append_arrays(vtkDataSet& data, bool of_cells, const char* suffix, std::vector<VtkAttribute>& attributes) {
  vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
  const std::vector<VtkAttribute> taken = attributes;
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    if (is_bookkeeping(arrays, i, name) || (of_cells && name == "HigherOrderDegrees")) continue;
    std::vector<VtkAttribute> added;
    append_array({name, name, array->GetNumberOfComponents(), 0, of_cells}, added);
    const bool clashes = std::ranges::any_of(added, [&](const VtkAttribute& attribute) {
      return std::ranges::find(taken, attribute.name, &VtkAttribute::name) != taken.end();
    });
    if (clashes) {
      added.clear();
      append_array({name + suffix, name, array->GetNumberOfComponents(), 0, of_cells}, added);
    }
    attributes.insert(attributes.end(), added.begin(), added.end());
  }
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

std::vector<VtkAttribute> attributes_of(vtkDataSet& data, CellValues cells) {
  const bool own = cells == CellValues::own;
  std::vector<VtkAttribute> attributes;
  append_arrays(data, own, "", attributes);
  append_arrays(data, !own, (own ? points_suffix : cells_suffix).data(), attributes);
  return attributes;
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

std::string full_name(const VtkAttribute& attribute) {
  std::string name = attribute.array;
  name += attribute.of_cells ? cells_suffix : points_suffix;
  if (attribute.components > 1 && attribute.component != VtkAttribute::magnitude)
    name += fmt::format("[{}]", attribute.component);
  return name;
}

Result<VtkValues> find_values(const std::string& path, vtkDataSet& data, std::span<const VtkAttribute> attributes,
                              std::size_t number) {
  const VtkAttribute& attribute = attributes[number];
  const auto array_of = [&](bool of_cells) {
    vtkDataArray* array = arrays_of(data, of_cells).GetArray(attribute.array.c_str());
    return array && array->GetNumberOfComponents() == attribute.components ? array : nullptr;
  };
  VtkValues values{array_of(attribute.of_cells), attribute.of_cells};
  const bool other_taken = std::ranges::any_of(attributes, [&](const VtkAttribute& other) {
    return other.array == attribute.array && other.of_cells != attribute.of_cells;
  });
  if (!values.array && !other_taken) values = {array_of(!attribute.of_cells), !attribute.of_cells};
  if (!values.array)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" ({} components) of the first piece is not in this one",
                path, attribute.array, attribute.components);
  const vtkIdType expected = values.of_cells ? data.GetNumberOfCells() : data.GetNumberOfPoints();
  if (values.array->GetNumberOfTuples() < expected)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} {}", path, attribute.array,
                values.array->GetNumberOfTuples(), expected, values.of_cells ? "cells" : "points");
  return values;
}

std::vector<double> attribute_values(const VtkAttribute& attribute,
                                     const std::function<std::vector<double>(int)>& component) {
  std::vector<double> values;
  if (attribute.component != VtkAttribute::magnitude) {
    values = component(attribute.component);
  } else {
    for (int c = 0; c < attribute.components; ++c) {
      const std::vector<double> next = component(c);
      values.resize(next.size());
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::hypot(values[i], next[i]);
    }
  }
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
