#include "builder/sources/data_set.h"

#include <numeric>

namespace splatvol {

Result<FoundArray> find_array(const std::string& path, const DataSet& data, const ArrayAttribute& attribute) {
  auto array = data.array(attribute.array, attribute.of_cells);
  const bool elsewhere = !array && !attribute.has_twin;
  if (elsewhere) array = data.array(attribute.array, !attribute.of_cells);
  if (!array) return FoundArray{nullptr, attribute.of_cells};
  const FoundArray found{std::move(*array), attribute.of_cells != elsewhere};
  if (!found.array)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" holds texts here, and numbers elsewhere", path,
                attribute.array);
  if (found.array->components() != attribute.components)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} components here, and {} elsewhere", path,
                attribute.array, found.array->components(), attribute.components);
  const std::uint64_t expected = found.of_cells ? data.cell_count() : data.point_count();
  if (found.array->size() < expected)
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} {}", path, attribute.array,
                found.array->size(), expected, found.of_cells ? "cells" : "points");
  return found;
}

std::vector<double> component_values(const NumberArray& array, int component, std::uint64_t count) {
  std::vector<std::uint32_t> elements(count);
  std::iota(elements.begin(), elements.end(), 0u);
  std::vector<double> values(count);
  array.read(component, elements, values);
  return values;
}

}  // namespace splatvol
