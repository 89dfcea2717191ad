#include "builder/sources/vtk/attributes.h"

#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkInformation.h>
#include <vtkInformationStringKey.h>
#include <vtkNew.h>
#include <vtkPointData.h>

#include <algorithm>
#include <cmath>

#include "builder/sources/source.h"

namespace splatvol {
namespace {

std::vector<double> read_attribute(const VtkAttribute& attribute, vtkDataArray& array,
                                   std::span<const std::uint32_t> points) {
  std::vector<double> values(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    double value = 0;
    if (attribute.component != VtkAttribute::magnitude) {
      value = array.GetComponent(points[i], attribute.component);
    } else {
      for (int c = 0; c < attribute.components; ++c) value = std::hypot(value, array.GetComponent(points[i], c));
    }
    values[i] = finite_or_missing(value);
  }
  return values;
}

}  // namespace

bool is_ghost_array(std::string_view name) { return name == "vtkGhostType" || name == "vtkGhostLevels"; }

bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name) {
  const int role = data.IsArrayAnAttribute(index);
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
}

bool wants_array(const std::vector<std::string>& selection, const std::string& array) {
  return selection.empty() || std::ranges::any_of(selection, [&](const std::string& name) {
           return name == array || name.starts_with(array + "[");
         });
}

std::vector<VtkAttribute> attributes_of(vtkDataSet& data) {
  std::vector<VtkAttribute> attributes;
  vtkPointData& arrays = *data.GetPointData();
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    const int components = array->GetNumberOfComponents();
    if (is_bookkeeping(arrays, i, name)) continue;
    if (components == 1) {
      attributes.push_back({name, name, 1, 0});
      continue;
    }
    attributes.push_back({name, name, components, VtkAttribute::magnitude});
    for (int c = 0; c < components; ++c) attributes.push_back({fmt::format("{}[{}]", name, c), name, components, c});
  }
  return attributes;
}

void add_missing(vtkDataSet& data, std::span<const ArrayShape> shapes) {
  for (const ArrayShape& shape : shapes) {
    if (data.GetPointData()->HasArray(shape.name.c_str())) continue;
    const vtkNew<vtkDoubleArray> array;
    array->SetName(shape.name.c_str());
    array->SetNumberOfComponents(shape.components);
    array->SetNumberOfTuples(data.GetNumberOfPoints());
    array->Fill(missing_value);
    data.GetPointData()->AddArray(array);
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

Result<std::vector<std::vector<double>>> read_attributes(const std::string& path, vtkDataSet& data,
                                                         std::span<const VtkAttribute> attributes,
                                                         std::span<const std::uint32_t> points) {
  std::vector<std::vector<double>> values;
  for (const VtkAttribute& attribute : attributes) {
    vtkDataArray* array = data.GetPointData()->GetArray(attribute.array.c_str());
    if (!array || array->GetNumberOfComponents() != attribute.components)
      return fail(ErrorCode::invalid_data, "{}: the array \"{}\" ({} components) of the first piece is not in this one",
                  path, attribute.array, attribute.components);
    if (array->GetNumberOfTuples() < data.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} points", path, attribute.array,
                  array->GetNumberOfTuples(), data.GetNumberOfPoints());
    values.push_back(read_attribute(attribute, *array, points));
  }
  return values;
}

}  // namespace splatvol
