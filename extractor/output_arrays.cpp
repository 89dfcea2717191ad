#include "extractor/output_arrays.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

constexpr std::size_t dimensions = 3;

bool has_name(const format::VolumeInfo& info, const std::string& name) {
  return std::ranges::find(info.attributes, name, &format::Attribute::name) != info.attributes.end() ||
         std::ranges::find(info.aliases, name, &format::Alias::name) != info.aliases.end();
}

// The numbers of a vector's components in the selection; empty if it is no vector, or not all of it is selected.
std::vector<std::size_t> components_of(const std::string& vector, const format::VolumeInfo& info,
                                       const format::SplatSelection& selection) {
  std::vector<std::size_t> components;
  for (std::size_t c = 0; c < dimensions; ++c) {
    const auto found = std::ranges::find(selection.names, fmt::format("{}[{}]", vector, c));
    if (found == selection.names.end()) return {};
    components.push_back(static_cast<std::size_t>(found - selection.names.begin()));
  }
  return has_name(info, fmt::format("{}[{}]", vector, dimensions)) ? std::vector<std::size_t>() : components;
}

// The name of the vector that an attribute may belong to, as its magnitude or as one of the components.
std::string vector_of(const std::string& attribute) {
  for (std::size_t c = 0; c < dimensions; ++c)
    if (const std::string end = fmt::format("[{}]", c); attribute.ends_with(end))
      return attribute.substr(0, attribute.size() - end.size());
  return attribute;
}

}  // namespace

std::vector<OutputArray> output_arrays(const format::VolumeInfo& info, const format::SplatSelection& selection) {
  std::vector<OutputArray> arrays;
  for (std::size_t i = 0; i < selection.names.size(); ++i) {
    const std::string vector = vector_of(selection.names[i]);
    std::vector<std::size_t> members = components_of(vector, info, selection);
    const bool is_vector = !members.empty();
    if (is_vector && std::ranges::find(arrays, members, &OutputArray::members) != arrays.end()) continue;
    if (!is_vector) members = {i};
    const format::Attribute& first = info.attributes[selection.attributes[members[0]]];
    arrays.push_back({is_vector ? vector : selection.names[i], first.unit, std::move(members)});
  }
  return arrays;
}

std::vector<std::string> names_of(std::span<const OutputArray> arrays) {
  std::vector<std::string> names;
  for (const OutputArray& array : arrays) names.push_back(array.name);
  return names;
}

std::span<const double> numbers_of(const OutputArray& array, std::span<const std::vector<double>> values,
                                   std::vector<double>& joined) {
  if (array.components() == 1) return values[array.members[0]];
  joined.clear();
  const std::size_t points = values[array.members[0]].size();
  joined.reserve(points * array.components());
  for (std::size_t p = 0; p < points; ++p)
    for (const std::size_t member : array.members) joined.push_back(values[member][p]);
  return joined;
}

}  // namespace splatvol
