#include "builder/sources/array_attributes.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

#include "base/hypotenuse.h"

namespace splatvol {
namespace {

/// The attributes of one array: a number gives one, a vector its magnitude and components.
std::vector<ArrayAttribute> attributes_of(const NamedArray& array, std::string_view suffix, bool of_cells) {
  std::vector<ArrayAttribute> attributes = {
      {array.name + std::string(suffix), array.name, array.components, 0, of_cells}};
  if (array.components == 1) return attributes;
  const std::string vector = attributes[0].name;
  attributes[0].component = ArrayAttribute::magnitude;
  for (int c = 0; c < array.components; ++c) {
    attributes.push_back(attributes[0]);
    attributes.back().name = fmt::format("{}[{}]", vector, c);
    attributes.back().component = c;
  }
  return attributes;
}

/// Appends the attributes of the points' arrays, or of the cells'. `others`: the arrays of the other ones. `suffix`:
/// for names that are taken already.
void append_arrays(std::span<const NamedArray> arrays, std::span<const NamedArray> others, bool of_cells,
                   std::string_view suffix, std::vector<ArrayAttribute>& attributes) {
  std::unordered_set<std::string> taken, of_others;
  for (const ArrayAttribute& attribute : attributes) taken.insert(attribute.name);
  for (const NamedArray& array : others) of_others.insert(array.name);
  for (const NamedArray& array : arrays) {
    std::vector<ArrayAttribute> added = attributes_of(array, "", of_cells);
    const bool clashes =
        std::ranges::any_of(added, [&](const ArrayAttribute& attribute) { return taken.contains(attribute.name); });
    if (clashes) added = attributes_of(array, suffix, of_cells);
    for (ArrayAttribute& attribute : added) attribute.has_twin = of_others.contains(array.name);
    attributes.insert(attributes.end(), added.begin(), added.end());
  }
}

}  // namespace

tl::unexpected<Error> fail_too_many_attributes(const std::string& file) {
  return fail(ErrorCode::unsupported, "{}: more than {} attributes", file, AttributeCount::most);
}

Status check_attribute_count(const std::string& file, std::span<const NamedArray> of_points,
                             std::span<const NamedArray> of_cells) {
  AttributeCount count;
  for (const std::span<const NamedArray> arrays : {of_points, of_cells})
    for (const NamedArray& array : arrays)
      if (!count.add(static_cast<std::uint64_t>(array.components))) return fail_too_many_attributes(file);
  return {};
}

std::vector<ArrayAttribute> attributes_of(std::span<const NamedArray> of_points, std::span<const NamedArray> of_cells,
                                          CellValues cells) {
  const bool own = cells == CellValues::own;
  std::vector<ArrayAttribute> attributes;
  append_arrays(own ? of_cells : of_points, own ? of_points : of_cells, own, "", attributes);
  append_arrays(own ? of_points : of_cells, own ? of_cells : of_points, !own, own ? points_suffix : cells_suffix,
                attributes);
  return attributes;
}

std::string full_name(const ArrayAttribute& attribute) {
  std::string name = attribute.array;
  name += attribute.of_cells ? cells_suffix : points_suffix;
  if (attribute.components > 1 && attribute.component != ArrayAttribute::magnitude)
    name += fmt::format("[{}]", attribute.component);
  return name;
}

std::vector<std::string> names_of(const std::vector<ArrayAttribute>& attributes) {
  std::vector<std::string> names;
  for (const ArrayAttribute& attribute : attributes) names.push_back(attribute.name);
  return names;
}

std::vector<int> components_of(const std::vector<ArrayAttribute>& attributes) {
  std::vector<int> components;
  for (const ArrayAttribute& attribute : attributes)
    components.push_back(attribute.component == ArrayAttribute::magnitude ? attribute.components : 1);
  return components;
}

std::string components_text(int components) {
  return components == 1 ? "a number" : fmt::format("a vector of {} components", components);
}

Status check_components(const std::string& name, const std::vector<std::string>& attributes,
                        const std::vector<int>& components, const std::string& other,
                        const std::vector<int>& expected) {
  for (std::size_t a = 0; a < attributes.size(); ++a)
    if (components[a] != expected[a])
      return fail(ErrorCode::invalid_data,
                  "{}: \"{}\" is {}, and {} in {}: choose attributes that are the same by --attribute", name,
                  attributes[a], components_text(components[a]), components_text(expected[a]), other);
  return {};
}

Result<std::vector<std::size_t>> match_attributes(const std::string& name, const std::vector<std::string>& attributes,
                                                  const std::string& other, const std::vector<std::string>& expected) {
  std::unordered_map<std::string_view, std::size_t> numbers;
  for (std::size_t a = 0; a < attributes.size(); ++a) numbers.emplace(attributes[a], a);
  std::vector<std::size_t> order;
  std::vector<std::string_view> lacking, more;
  for (const std::string& attribute : expected)
    if (const auto node = numbers.extract(attribute))
      order.push_back(node.mapped());
    else
      lacking.push_back(attribute);
  for (const std::string& attribute : attributes)
    if (numbers.contains(attribute)) more.push_back(attribute);
  if (lacking.empty() && more.empty()) return order;
  const std::string lacks = lacking.empty() ? "" : fmt::format("lacks {}", fmt::join(lacking, ", ")),
                    has = more.empty() ? "" : fmt::format("has {} besides", fmt::join(more, ", "));
  return fail(ErrorCode::invalid_data,
              "{}: its attributes are not those of {}: it {}{}{}: choose common ones by --attribute", name, other,
              lacks, lacks.empty() || has.empty() ? "" : ", and ", has);
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

std::vector<ArrayAttribute> select_attributes(const std::vector<ArrayAttribute>& all,
                                              const std::vector<std::string>& selection, CellValues cells,
                                              std::string& missing, bool may_lack) {
  if (selection.empty()) return all;
  const bool own = cells == CellValues::own;
  const std::unordered_set<std::string_view> selected_names(selection.begin(), selection.end());
  std::unordered_map<std::string_view, std::size_t> numbers;
  for (std::size_t i = 0; i < all.size(); ++i) {
    // If both names are selected, others have both arrays, and here the one of the plain name lacks.
    const bool only_full = may_lack && all[i].of_cells != own && selected_names.contains(full_name(all[i]));
    if (!only_full) numbers.emplace(all[i].name, i);
  }
  std::vector<ArrayAttribute> selected;
  for (const std::string& name : selection) {
    const auto number = numbers.find(name);
    auto attribute = number == numbers.end() ? all.end() : all.begin() + static_cast<std::ptrdiff_t>(number->second);
    if (attribute == all.end())
      attribute = std::ranges::find_if(all, [&](const ArrayAttribute& converted) {
        return converted.of_cells != own && full_name(converted) == name;
      });
    if (attribute != all.end()) {
      selected.push_back(*attribute);
      selected.back().name = name;
      continue;
    }
    if (missing.empty()) missing = name;
    if (may_lack) selected.push_back({.name = name, .array = name, .of_cells = own, .has_twin = true});
  }
  return selected;
}

std::vector<double> attribute_values(const ArrayAttribute& attribute,
                                     const std::function<std::vector<double>(int)>& component) {
  std::vector<double> values;
  if (attribute.component != ArrayAttribute::magnitude) return component(attribute.component);
  for (int c = 0; c < attribute.components; ++c) {
    const std::vector<double> next = component(c);
    values.resize(next.size());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = hypotenuse(values[i], next[i]);
  }
  return values;
}

}  // namespace splatvol
