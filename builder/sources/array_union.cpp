#include "builder/sources/array_union.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <utility>

#include "base/names.h"

namespace splatvol {
namespace {

/// The names of arrays that a part has at its points and in its cells.
std::unordered_set<std::string> names_of_both(std::span<const ArrayShape> arrays) {
  std::unordered_set<std::string> seen, both;
  for (const ArrayShape& array : arrays)
    if (!seen.insert(array.name).second) both.insert(array.name);
  return both;
}

/// Fails if two arrays at the points, or in the cells, have the same name: only one of them could be read.
Status check_names(const std::string& part, std::span<const ArrayShape> arrays) {
  std::array<std::vector<std::string>, 2> names;
  for (const ArrayShape& array : arrays)
    if (array.of_cells) names[*array.of_cells ? 1 : 0].push_back(array.name);
  for (const std::size_t of_cells : {0u, 1u})
    if (const auto duplicate = find_duplicate(std::move(names[of_cells])))
      return fail(ErrorCode::invalid_data, "{}: two arrays of its {} are called \"{}\": rename one", part,
                  of_cells == 0 ? "points" : "cells", *duplicate);
  return {};
}

}  // namespace

std::vector<ArrayShape> wanted_arrays(std::vector<ArrayShape> arrays, const std::vector<std::string>& selection) {
  std::erase_if(arrays, [&](const ArrayShape& array) { return !wants_array(selection, array.name); });
  return arrays;
}

/// The array that a part's array is, if there is one.
std::optional<std::size_t> ArrayUnion::find(const ArrayShape& array, bool part_has_both) const {
  const auto of_name = numbers_.find(array.name);
  if (of_name == numbers_.end()) return std::nullopt;
  const std::vector<std::size_t>& numbers = of_name->second;
  const auto is_same_kind = [&](std::size_t number) {
    const std::optional<bool>& known = arrays_[number].of_cells;
    return !known || !array.of_cells || *known == *array.of_cells;
  };
  if (const auto same = std::ranges::find_if(numbers, is_same_kind); same != numbers.end()) return *same;
  return part_has_both ? std::nullopt : std::optional(numbers.front());
}

Status ArrayUnion::check_components(const std::string& part, const ArrayShape& array, std::size_t known) const {
  if (array.components == arrays_[known].components) return {};
  return fail(ErrorCode::invalid_data,
              "{}: the array \"{}\" is {}, and {} in {}: rename one, or choose others by --attribute", part, array.name,
              components_text(array.components), components_text(arrays_[known].components), parts_[known]);
}

Status ArrayUnion::add(const std::string& part, std::span<const ArrayShape> arrays) {
  SPLATVOL_TRY(check_names(part, arrays));
  const std::unordered_set<std::string> both = names_of_both(arrays);
  for (const ArrayShape& array : arrays) {
    if (array.of_cells.value_or(false)) of_cells_.insert(array.name);
    if (const auto known = find(array, both.contains(array.name))) {
      SPLATVOL_TRY(check_components(part, array, *known));
      ArrayShape& same = arrays_[*known];
      if (!same.of_cells) same.of_cells = array.of_cells;
      if (same.unit.empty()) same.unit = array.unit;
      continue;
    }
    numbers_[array.name].push_back(arrays_.size());
    arrays_.push_back(array);
    parts_.push_back(part);
  }
  return {};
}

Status ArrayUnion::check(const std::string& part, std::span<const ArrayShape> arrays) const {
  const std::unordered_set<std::string> both = names_of_both(arrays);
  for (const ArrayShape& array : arrays) {
    const auto known = find(array, both.contains(array.name));
    if (!known)
      return fail(ErrorCode::invalid_data,
                  "{}: the array \"{}\" turns up here, and the headers that were read first do not have it: choose "
                  "others by --attribute",
                  part, array.name);
    SPLATVOL_TRY(check_components(part, array, *known));
  }
  return {};
}

std::string ArrayUnion::unit(const std::string& name) const {
  const auto named =
      std::ranges::find_if(arrays_, [&](const ArrayShape& array) { return array.name == name && !array.unit.empty(); });
  return named == arrays_.end() ? std::string() : named->unit;
}

Result<std::vector<ArrayAttribute>> ArrayUnion::attributes(const std::string& file, CellValues cells) const {
  std::vector<NamedArray> of_points, of_cells;
  for (const ArrayShape& array : arrays_)
    (array.of_cells.value_or(cells == CellValues::own) ? of_cells : of_points)
        .push_back({array.name, array.components});
  SPLATVOL_TRY(check_attribute_count(file, of_points, of_cells));
  auto all = attributes_of(of_points, of_cells, cells);
  if (const auto duplicate = find_duplicate(names_of(all)))
    return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", file, *duplicate);
  return all;
}

Result<ArrayUnion> unite_columns(std::span<const TableColumns> tables) {
  ArrayUnion columns;
  for (const TableColumns& table : tables) {
    std::vector<ArrayShape> shapes;
    for (std::size_t i = 0; i < table.names.size(); ++i)
      shapes.push_back({table.names[i], 1, false, i < table.units.size() ? table.units[i] : std::string()});
    SPLATVOL_TRY(columns.add(table.file, shapes));
  }
  return columns;
}

Result<std::vector<std::string>> choose_columns(const std::string& file, const ArrayUnion& columns,
                                                const SourceOptions& options) {
  std::vector<std::string> names;
  for (const ArrayShape& column : columns.arrays()) names.push_back(column.name);
  for (const std::string& name : options.selection)
    if (!options.may_lack && std::ranges::find(names, name) == names.end()) return fail_no_attribute(file, name, names);
  if (!options.selection.empty()) names = options.selection;
  if (names.size() > AttributeCount::most) return fail_too_many_attributes(file);
  return names;
}

std::string describe_lacking(std::span<const std::string> names) {
  return fmt::format("{}: missing where a part of the input lacks it", fmt::join(names, ", "));
}

}  // namespace splatvol
