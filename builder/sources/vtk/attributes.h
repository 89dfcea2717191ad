// The attributes in a VTK data set: its arrays of numbers at the points.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

class vtkDataSet;
class vtkDataSetAttributes;

namespace splatvol {

/// An attribute, and the array that holds it: one of its components, or its magnitude.
struct VtkAttribute {
  static constexpr int magnitude = -1;
  std::string name;
  std::string array;
  int components = 1;
  int component = 0;
};

/// Whether an array of this name marks points or cells as ghost copies or hidden.
[[nodiscard]] bool is_ghost_array(std::string_view name);

/// Whether array `index`, of this name, is one that VTK or a filter made for its own use.
[[nodiscard]] bool is_bookkeeping(vtkDataSetAttributes& data, int index, const std::string& name);

/// Whether a selection of attributes needs an array: by its name, or by the name of one of its components.
[[nodiscard]] bool wants_array(const std::vector<std::string>& selection, const std::string& array);

/// The name and form of an array.
struct ArrayShape {
  std::string name;
  int components = 1;
};

/// Adds the arrays that the points of a block lack, filled with NaN.
void add_missing(vtkDataSet& data, std::span<const ArrayShape> shapes);

/// Lists all attributes of a data set, in the order of its arrays. Strings, ghost flags and ids are no attributes.
[[nodiscard]] std::vector<VtkAttribute> attributes_of(vtkDataSet& data);

/// The unit that a file gives an array of the points or of the cells in VTK's own way (the key UNITS_LABEL); empty if
/// there is none.
[[nodiscard]] std::string unit_label(vtkDataSet& data, const std::string& array);

/// Reads the values of `attributes` at `points`, in the form of Piece::values. Fails if an attribute's array is not
/// there, has another number of components, or is too short; `path` begins the message. Requires points in range.
[[nodiscard]] Result<std::vector<std::vector<double>>> read_attributes(const std::string& path, vtkDataSet& data,
                                                                       std::span<const VtkAttribute> attributes,
                                                                       std::span<const std::uint32_t> points);

}  // namespace splatvol
