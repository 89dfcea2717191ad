#include "format/series_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/json.h"
#include "base/nesting.h"

namespace splatvol::format {
namespace {

using nlohmann::ordered_json;

// An index of ours has 3 levels.
constexpr int max_nesting = 32;

// Of a file in the folder of the index. The system would end a name at the character NUL.
bool is_file_name(const std::string& file) {
  return !file.empty() && file != "." && file != ".." && file.find_first_of(std::string_view("/\0", 2)) == file.npos;
}

bool is_step(const nlohmann::json& step) {
  return step.is_object() && step.contains("time") && step["time"].is_number() && step.contains("file") &&
         step["file"].is_string() && std::isfinite(step["time"].get<double>());
}

// A number, or null for none.
ordered_json bound_to_json(double bound) { return std::isnan(bound) ? ordered_json() : ordered_json(bound); }

bool read_bound(const nlohmann::json& attribute, const char* key, double& bound) {
  if (!attribute.contains(key)) return false;
  const nlohmann::json& number = attribute[key];
  if (!number.is_number() && !number.is_null()) return false;
  bound = number.is_null() ? std::numeric_limits<double>::quiet_NaN() : number.get<double>();
  return !std::isinf(bound);
}

bool read_attribute(const nlohmann::json& json, SeriesIndex::Attribute& attribute) {
  const auto is_text = [&](const char* key) { return json.contains(key) && json[key].is_string(); };
  if (!json.is_object() || !is_text("name") || !is_text("unit")) return false;
  attribute.name = json["name"].get<std::string>();
  attribute.unit = json["unit"].get<std::string>();
  StepRange& range = attribute.range;
  if (!read_bound(json, "min", range.min) || !read_bound(json, "max", range.max)) return false;
  return range.min <= range.max || (std::isnan(range.min) && std::isnan(range.max));
}

Status read_attributes(const nlohmann::json& document, SeriesIndex& index) {
  if (!document.contains("attributes") || !document["attributes"].is_array())
    return fail(ErrorCode::invalid_data, "not the index of a time series: no list \"attributes\"");
  for (const nlohmann::json& json : document["attributes"]) {
    SeriesIndex::Attribute attribute;
    if (!read_attribute(json, attribute))
      return fail(ErrorCode::invalid_data,
                  "attribute {} lacks a \"name\", a \"unit\", or a range from \"min\" to \"max\"",
                  index.attributes.size());
    if (std::ranges::find(index.attributes, attribute.name, &SeriesIndex::Attribute::name) != index.attributes.end())
      return fail(ErrorCode::invalid_data, "the attribute \"{}\" is there twice", attribute.name);
    index.attributes.push_back(std::move(attribute));
  }
  return {};
}

}  // namespace

void include(StepRange& range, double min, double max) {
  range.min = std::fmin(range.min, min);
  range.max = std::fmax(range.max, max);
}

bool is_same(const StepRange& a, const StepRange& b) {
  const auto same = [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); };
  return same(a.min, b.min) && same(a.max, b.max);
}

std::string to_json(const SeriesIndex& index) {
  ordered_json steps = ordered_json::array();
  for (const SeriesIndex::Step& step : index.steps) steps.push_back({{"time", step.time}, {"file", step.file}});
  ordered_json attributes = ordered_json::array();
  for (const SeriesIndex::Attribute& attribute : index.attributes)
    attributes.push_back({{"name", attribute.name},
                          {"unit", attribute.unit},
                          {"min", bound_to_json(attribute.range.min)},
                          {"max", bound_to_json(attribute.range.max)}});
  const ordered_json document = {{"steps", steps}, {"attributes", attributes}};
  return json_text(document, 1) + "\n";
}

Result<SeriesIndex> series_index_from_json(const std::string& text) {
  if (is_nested_deeper(text, max_nesting))
    return fail(ErrorCode::invalid_data, "not the index of a time series: nested deeper than {} levels", max_nesting);
  const nlohmann::json document = parse_json_or_discard(text);
  if (!document.is_object() || !document.contains("steps") || !document["steps"].is_array())
    return fail(ErrorCode::invalid_data, "not the index of a time series: no list \"steps\"");
  SeriesIndex index;
  for (const nlohmann::json& step : document["steps"]) {
    const std::size_t number = index.steps.size();
    if (!is_step(step)) return fail(ErrorCode::invalid_data, "step {} lacks a \"time\" or a \"file\"", number);
    index.steps.push_back({step["time"].get<double>(), step["file"].get<std::string>()});
    const std::string& file = index.steps.back().file;
    if (!is_file_name(file))
      return fail(ErrorCode::invalid_data, "step {}: \"{}\" is not the name of a file in the same folder", number,
                  file);
    if (number > 0 && !(index.steps[number].time > index.steps[number - 1].time))
      return fail(ErrorCode::invalid_data, "step {}: its time is not behind that of the step before", number);
  }
  if (index.steps.empty()) return fail(ErrorCode::invalid_data, "a time series without steps");
  SPLATVOL_TRY(read_attributes(document, index));
  return index;
}

}  // namespace splatvol::format
