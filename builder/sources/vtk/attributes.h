// The attributes in a VTK data set: its arrays of numbers at the points and in the cells.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

class vtkDataArray;
class vtkDataSet;
class vtkDataSetAttributes;

namespace splatvol {

/// Whether an array of this name marks points or cells as ghost copies or hidden.
[[nodiscard]] bool is_ghost_array(std::string_view name);

/// Whether a name is that of an array that VTK or a filter made for its own use.
[[nodiscard]] bool is_bookkeeping(std::string_view name);

/// The same for array `index`, of this name, which may also be one of ids.
[[nodiscard]] bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name);

/// The arrays of the cells of a data set, or of its points.
[[nodiscard]] vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells);

/// Makes the names of a data set's arrays UTF-8, by as_utf8 (base/printable.h).
void name_in_utf8(vtkDataSet& data);

/// Lists the arrays of a data set that give attributes. Strings, ghost flags and ids give none.
[[nodiscard]] std::vector<ArrayShape> array_shapes(vtkDataSet& data);

/// The unit that a file gives an array of the points or of the cells in VTK's own way (the key UNITS_LABEL); empty if
/// there is none.
[[nodiscard]] std::string unit_label(vtkDataSet& data, const std::string& array);

/// An array with the values of an attribute, and whether it is one of the cells. Null: the data set has no such array.
struct VtkValues {
  vtkDataArray* array = nullptr;
  bool of_cells = false;
};

/// Finds the array of an attribute. If the data set does not have it, takes one of the same name that belongs to the
/// other of points and cells, unless this is another attribute (ArrayAttribute::has_twin). Fails if the array holds no
/// numbers, has another number of components, or is too short; `path` begins the message.
[[nodiscard]] Result<VtkValues> find_values(const std::string& path, vtkDataSet& data, const ArrayAttribute& attribute);

/// Reads one component of an array, an element for each index. Requires indices in range. Thread-safe.
void read_component(vtkDataArray& array, int component, std::span<const std::uint32_t> indices,
                    std::span<double> values);

/// Returns one component of an array. Requires indices in range.
[[nodiscard]] std::vector<double> component_values(vtkDataArray& array, int component,
                                                   std::span<const std::uint32_t> indices);

}  // namespace splatvol
