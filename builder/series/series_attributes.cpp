#include "builder/series/series_attributes.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

using Attributes = std::vector<ArrayAttribute>;

/// The attributes of each step, and of all.
struct ListedSteps {
  std::vector<std::optional<Attributes>> steps;  // none: only opening the step tells
  Attributes all;
};

Result<ListedSteps> list_steps(const std::vector<StepInput>& inputs) {
  ListedSteps listed;
  ArrayUnion all;
  for (const StepInput& input : inputs) {
    std::optional<std::vector<ArrayShape>> arrays;
    SPLATVOL_TRY_SET(arrays, input.list(input.options));
    listed.steps.emplace_back();
    if (!arrays) continue;
    ArrayUnion own;
    SPLATVOL_TRY(own.add(input.name, *arrays));
    SPLATVOL_TRY(all.add(input.name, *arrays));
    SPLATVOL_TRY_SET(listed.steps.back(), own.attributes(input.name, input.options.cells));
  }
  SPLATVOL_TRY_SET(listed.all, all.attributes(inputs.front().name, inputs.front().options.cells));
  return listed;
}

/// The first of some names that is not among attributes; empty if all are.
std::string first_lacking(const Attributes& attributes, const std::vector<std::string>& names, CellValues cells) {
  std::string lacking;
  static_cast<void>(select_attributes(attributes, names, cells, lacking, true));
  return lacking;
}

bool any_lacks(const ListedSteps& listed, const std::vector<std::string>& names, CellValues cells) {
  return std::ranges::any_of(listed.steps, [&](const std::optional<Attributes>& step) {
    return step && !first_lacking(*step, names, cells).empty();
  });
}

/// The attributes of any step, in the order of the first.
Result<std::vector<std::string>> names_of_any(const StepInput& first, const Attributes& all) {
  SPLATVOL_TRY_ASSIGN(source, first.open(first.options));
  std::vector<std::string> names = source->attributes();
  for (const ArrayAttribute& attribute : all)
    if (std::ranges::find(names, attribute.name) == names.end()) names.push_back(attribute.name);
  return names;
}

/// The vector that an attribute is a component of: "U" of "U[0]". Empty if it is none.
std::string vector_of(const std::string& name) {
  return name.ends_with(']') ? name.substr(0, name.rfind('[')) : std::string();
}

/// Fails if a step has an attribute that the series does not have, or a vector in place of a number, or the reverse.
Status check_fields(const std::string& step, const Attributes& attributes, const std::vector<std::string>& series) {
  const auto has = [](const auto& names, const std::string& name) {
    return std::ranges::find(names, name) != names.end();
  };
  const auto components_in_series = [&](const std::string& vector) {
    int components = 0;
    while (has(series, fmt::format("{}[{}]", vector, components))) ++components;
    return std::max(components, 1);
  };
  const std::vector<std::string> names = names_of(attributes);
  const std::string choice = fmt::format("{}", fmt::join(series, " --attribute "));
  for (const ArrayAttribute& attribute : attributes) {
    if (has(series, attribute.name)) continue;
    const std::string vector = vector_of(attribute.name);
    if (const int components = components_in_series(vector); has(series, vector) && components > 1)
      return fail(ErrorCode::invalid_data, "{}: \"{}\" is {}, and {} in the series: rename or remove it", step, vector,
                  components_text(attribute.components), components_text(components));
    if (has(series, vector))
      return fail(ErrorCode::invalid_data,
                  "{}: \"{}\" is {}, and a number in the series: append its magnitude by --attribute {}", step, vector,
                  components_text(attribute.components), choice);
    return fail(ErrorCode::invalid_data,
                "{}: the series does not have the attribute \"{}\": leave it out by --attribute {}", step,
                attribute.name, choice);
  }
  for (const std::string& name : series)
    if (const std::string vector = vector_of(name); !has(names, name) && has(names, vector)) {
      const auto own = std::ranges::find(attributes, vector, &ArrayAttribute::name);
      if (own->components == 1)
        return fail(ErrorCode::invalid_data,
                    "{}: \"{}\" is a number, and the series has a vector of it, with \"{}\": rename or remove it", step,
                    vector, name);
      return fail(ErrorCode::invalid_data, "{}: \"{}\" is {}, and {} in the series: rename or remove it", step, vector,
                  components_text(own->components), components_text(components_in_series(vector)));
    }
  return {};
}

/// Chooses the attributes of all steps; none if each has its own, which are those of all.
Result<std::vector<std::string>> choose_attributes(const std::vector<StepInput>& inputs, const ListedSteps& listed,
                                                   const std::vector<std::string>& series) {
  const SourceOptions& options = inputs.front().options;
  if (!options.selection.empty()) return options.selection;
  for (std::size_t s = 0; s < inputs.size() && !series.empty(); ++s)
    if (listed.steps[s]) SPLATVOL_TRY(check_fields(inputs[s].name, *listed.steps[s], series));
  if (!series.empty()) return series;
  if (!any_lacks(listed, names_of(listed.all), options.cells)) return std::vector<std::string>();
  return names_of_any(inputs.front(), listed.all);
}

}  // namespace

Result<std::vector<SeriesStep>> make_steps(std::vector<StepInput> inputs, const std::vector<std::string>& series) {
  if (inputs.empty()) return std::vector<SeriesStep>();
  SPLATVOL_TRY_ASSIGN(listed, list_steps(inputs));
  SPLATVOL_TRY_ASSIGN(attributes, choose_attributes(inputs, listed, series));
  const CellValues cells = inputs.front().options.cells;
  const bool some_have = !series.empty() || first_lacking(listed.all, attributes, cells).empty();
  const bool may_lack = some_have && any_lacks(listed, attributes, cells);
  std::vector<SeriesStep> steps;
  for (StepInput& input : inputs) {
    input.options.selection = attributes;
    input.options.may_lack = may_lack;
    steps.push_back({input.name, input.time, [input] { return input.open(input.options); }});
  }
  return steps;
}

}  // namespace splatvol
