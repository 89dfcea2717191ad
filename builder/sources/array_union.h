// The arrays of all parts of an input: what one part lacks, another may have.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_attributes.h"

namespace splatvol {

/// The name and form of an array.
struct ArrayShape {
  std::string name;
  int components = 1;
  std::optional<bool> of_cells = {};  // empty: not known, or not the same in all blocks
  std::string unit = {};              // if the input tells
};

/// Returns those arrays that a selection needs (wants_array).
[[nodiscard]] std::vector<ArrayShape> wanted_arrays(std::vector<ArrayShape> arrays,
                                                    const std::vector<std::string>& selection);

/// The arrays that parts of an input have: its files, blocks, pieces or time steps. Arrays of one name are the same
/// array. Only if a part has it at points and in cells are these two arrays. A part may have the one array at its
/// points, and another part in its cells.
class ArrayUnion {
 public:
  /// Adds the arrays of one part. Fails if two arrays at its points, or in its cells, have the same name, or if an
  /// array has another number of components than in a part before; `part` begins the message.
  [[nodiscard]] Status add(const std::string& part, std::span<const ArrayShape> arrays);

  /// Fails if a part has an array that no part has that was added, or one with another number of components.
  [[nodiscard]] Status check(const std::string& part, std::span<const ArrayShape> arrays) const;

  /// In the order in which they came.
  [[nodiscard]] const std::vector<ArrayShape>& arrays() const { return arrays_; }

  /// The unit of an array of this name; empty if no part tells.
  [[nodiscard]] std::string unit(const std::string& name) const;

  /// Whether a part is known to have an array of this name in its cells.
  [[nodiscard]] bool is_of_cells(const std::string& name) const { return of_cells_.contains(name); }

  /// As attributes_of (builder/sources/array_attributes.h). An array that may be at points and in cells counts as one
  /// that needs no conversion. Fails if there are more attributes than a file can hold, or two of one name; `file`
  /// begins the message.
  [[nodiscard]] Result<std::vector<ArrayAttribute>> attributes(const std::string& file, CellValues cells) const;

 private:
  [[nodiscard]] std::optional<std::size_t> find(const ArrayShape& array, bool part_has_both) const;
  [[nodiscard]] Status check_components(const std::string& part, const ArrayShape& array, std::size_t known) const;

  std::vector<ArrayShape> arrays_;
  std::vector<std::string> parts_;                                     // [array]: the first that has it
  std::unordered_map<std::string, std::vector<std::size_t>> numbers_;  // of the arrays of a name
  std::unordered_set<std::string> of_cells_;                           // names
};

/// Lists the arrays of an input. Contract as list_arrays (builder/opening/open_source.h).
using ListArrays = std::function<Result<std::optional<std::vector<ArrayShape>>>(const std::vector<std::string>& inputs,
                                                                                const SourceOptions& options)>;

/// The columns of a table that are attributes.
struct TableColumns {
  std::string file;
  std::vector<std::string> names, units = {};
};

/// Returns the columns of several tables as arrays.
[[nodiscard]] Result<ArrayUnion> unite_columns(std::span<const TableColumns> tables);

/// Chooses the attributes of several tables: all, or those that the options select. Fails if no table has one of these
/// (unless SourceOptions::may_lack), or if there are more than a file can hold.
[[nodiscard]] Result<std::vector<std::string>> choose_columns(const std::string& file, const ArrayUnion& columns,
                                                              const SourceOptions& options);

/// The line for Source::conversions() on attributes that parts of an input lack.
[[nodiscard]] std::string describe_lacking(std::span<const std::string> names);

}  // namespace splatvol
