// The attributes in a VTK data set: its arrays of numbers at the points and in the cells.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/source.h"

class vtkDataArray;
class vtkDataSet;
class vtkDataSetAttributes;

namespace splatvol {

/// Whether an array of this name marks points or cells as ghost copies or hidden.
[[nodiscard]] bool is_ghost_array(std::string_view name);

/// Whether array `index`, of this name, is one that VTK or a filter made for its own use.
[[nodiscard]] bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name);

/// Whether a selection of attributes needs an array: by its name, or by the name of one of its components, also where
/// both points and cells have an array of this name.
[[nodiscard]] bool wants_array(const std::vector<std::string>& selection, const std::string& array);

/// The arrays of the cells of a data set, or of its points.
[[nodiscard]] vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells);

/// The name and form of an array.
struct ArrayShape {
  std::string name;
  int components = 1;
  std::optional<bool> of_cells = {};  // empty: not known, or not the same in all blocks
};

/// Adds the arrays that a block lacks, filled with NaN. An array that is known at points or cells alone may be at the
/// others here.
void add_missing(vtkDataSet& data, std::span<const ArrayShape> shapes, CellValues cells);

/// Lists all attributes of a data set, in the order of its arrays. Strings, ghost flags and ids are no attributes.
/// Fails if there are more than a file can hold; `path` begins the message.
[[nodiscard]] Result<std::vector<ArrayAttribute>> attributes_of(const std::string& path, vtkDataSet& data,
                                                                CellValues cells);

/// The unit that a file gives an array of the points or of the cells in VTK's own way (the key UNITS_LABEL); empty if
/// there is none.
[[nodiscard]] std::string unit_label(vtkDataSet& data, const std::string& array);

/// An array with the values of an attribute, and whether it is one of the cells.
struct VtkValues {
  vtkDataArray* array = nullptr;
  bool of_cells = false;
};

/// Finds the array of attribute `number`. If the data set does not have it, takes one of the same name that belongs to
/// the other of points and cells, unless another attribute has that. Fails if there is none with as many components, or
/// if it is too short; `path` begins the message.
[[nodiscard]] Result<VtkValues> find_values(const std::string& path, vtkDataSet& data,
                                            std::span<const ArrayAttribute> attributes, std::size_t number);

/// Reads one component of an array, an element for each index. Requires indices in range. Thread-safe.
void read_component(vtkDataArray& array, int component, std::span<const std::uint32_t> indices,
                    std::span<double> values);

/// Returns one component of an array. Requires indices in range.
[[nodiscard]] std::vector<double> component_values(vtkDataArray& array, int component,
                                                   std::span<const std::uint32_t> indices);

}  // namespace splatvol
