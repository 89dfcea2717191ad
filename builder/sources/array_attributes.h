// The attributes that arrays of numbers give: at the points of a mesh, and in its cells.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/source.h"
#include "format/layout.h"

namespace splatvol {

/// An attribute, and the array that holds it: one of its components, or its magnitude.
struct ArrayAttribute {
  static constexpr int magnitude = -1;
  std::string name;
  std::string array;
  int components = 1;
  int component = 0;
  bool of_cells = false;
  bool has_twin = false;   // points and cells both have an array of this name
  bool is_volume = false;  // no array's values, but the cells' volumes
};

/// Ends of the names of attributes whose array's name is taken.
inline constexpr std::string_view cells_suffix = " (cells)";
inline constexpr std::string_view points_suffix = " (points)";

/// An array of numbers by its name and form.
struct NamedArray {
  std::string name;
  int components = 1;
};

/// Counts the attributes of arrays. A hostile file may name any number of them.
class AttributeCount {
 public:
  static constexpr std::uint64_t most = format::max_attributes;

  /// Whether there may be one more array, with this number of components.
  [[nodiscard]] bool add(std::uint64_t components) {
    if (components > most || count_ > most) return false;
    count_ += components > 1 ? components + 1 : 1;
    return count_ <= most;
  }

 private:
  std::uint64_t count_ = 0;
};

/// Most arrays of a file for VTK's readers, which look for each among all others.
inline constexpr std::size_t most_vtk_arrays = 16384;

/// Returns the error that `file` has more than AttributeCount::most.
[[nodiscard]] tl::unexpected<Error> fail_too_many_attributes(const std::string& file);

/// Fails if arrays have more attributes than a file can hold. `file` begins the message.
[[nodiscard]] Status check_attribute_count(const std::string& file, std::span<const NamedArray> of_points,
                                           std::span<const NamedArray> of_cells);

/// Lists the attributes of arrays, in their order: an array of numbers gives one, a vector its magnitude and then its
/// components. First come the arrays that need no conversion: those of points, or of cells if they are points of their
/// own. An array of the others whose name is taken is called "NAME (cells)", or "NAME (points)".
[[nodiscard]] std::vector<ArrayAttribute> attributes_of(std::span<const NamedArray> of_points,
                                                        std::span<const NamedArray> of_cells, CellValues cells);

/// The name of an attribute as if its array's name were taken.
[[nodiscard]] std::string full_name(const ArrayAttribute& attribute);

[[nodiscard]] std::vector<std::string> names_of(const std::vector<ArrayAttribute>& attributes);

/// Returns what Source::components() does.
[[nodiscard]] std::vector<int> components_of(const std::vector<ArrayAttribute>& attributes);

/// Says what an attribute is by Source::components(): "a vector of 3 components".
[[nodiscard]] std::string components_text(int components);

/// Fails if an attribute is the magnitude of a vector in one of two inputs, and not of such a vector in the other.
/// `name` begins the message. `components` are its own, and `expected` those of `other`.
[[nodiscard]] Status check_components(const std::string& name, const std::vector<std::string>& attributes,
                                      const std::vector<int>& components, const std::string& other,
                                      const std::vector<int>& expected);

/// Finds each of the `expected` attributes of `other` among those of an input, which may have them in any order: the
/// numbers of these. Fails if the input lacks one or has another, with their names; `name` begins the message.
[[nodiscard]] Result<std::vector<std::size_t>> match_attributes(const std::string& name,
                                                                const std::vector<std::string>& attributes,
                                                                const std::string& other,
                                                                const std::vector<std::string>& expected);

/// Whether a selection of attributes needs an array: by its name, or by the name of one of its components, also where
/// both points and cells have an array of this name.
[[nodiscard]] bool wants_array(const std::vector<std::string>& selection, const std::string& array);

/// Returns those of `all` that a selection names, in its order; all if it is empty. The array that takes an attribute's
/// name may not have been read, so full names count too; a selection that has both names has both attributes. Sets
/// `missing` to the first name that is not there. With `may_lack`, such names too are in the result, for arrays that
/// no piece has.
[[nodiscard]] std::vector<ArrayAttribute> select_attributes(const std::vector<ArrayAttribute>& all,
                                                            const std::vector<std::string>& selection, CellValues cells,
                                                            std::string& missing, bool may_lack = false);

/// Returns an attribute's values: `component(c)` returns those of one component.
[[nodiscard]] std::vector<double> attribute_values(const ArrayAttribute& attribute,
                                                   const std::function<std::vector<double>(int)>& component);

}  // namespace splatvol
