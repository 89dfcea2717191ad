#include "format/series_index.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/json.h"
#include "base/names.h"

namespace splatvol::format {
namespace {

using nlohmann::ordered_json;

// An index of ours has 3 levels.
constexpr int max_nesting = 32;

// Of a file in the folder of the index. The system would end a name at the character NUL.
bool is_file_name(const std::string& file) {
  return !file.empty() && file != "." && file != ".." && file.find_first_of(std::string_view("/\0", 2)) == file.npos;
}

// A number, or null for none.
ordered_json bound_to_json(double bound) { return std::isnan(bound) ? ordered_json() : ordered_json(bound); }

Result<SeriesIndex::Step> read_step(const JsonField& json) {
  SeriesIndex::Step step;
  SPLATVOL_TRY_SET(step.time, json.member("time").number());
  const JsonField file = json.member("file");
  SPLATVOL_TRY_SET(step.file, file.text());
  if (!is_file_name(step.file)) return file.wrong("\"{}\" is not the name of a file in the same folder", step.file);
  return step;
}

Result<SeriesIndex::Attribute> read_attribute(const JsonField& json) {
  SeriesIndex::Attribute attribute;
  StepRange& range = attribute.range;
  SPLATVOL_TRY_SET(attribute.name, json.member("name").text());
  SPLATVOL_TRY_SET(attribute.unit, json.member("unit").text());
  SPLATVOL_TRY_SET(range.min, json.member("min").number_or_nan());
  SPLATVOL_TRY_SET(range.max, json.member("max").number_or_nan());
  const bool is_empty = std::isnan(range.min) && std::isnan(range.max);
  if (!is_empty && !(range.min <= range.max)) return json.wrong("no range from \"min\" to \"max\"");
  return attribute;
}

Result<SeriesIndex> read_index(const JsonField& root) {
  SeriesIndex index;
  const JsonField steps = root.member("steps"), attributes = root.member("attributes");
  SPLATVOL_TRY_SET(index.steps, steps.each(read_step));
  if (index.steps.empty()) return steps.wrong("a time series without steps");
  for (std::size_t i = 1; i < index.steps.size(); ++i)
    if (!(index.steps[i].time > index.steps[i - 1].time))
      return steps.element(i).wrong("its time is not behind that of the step before");
  SPLATVOL_TRY_SET(index.attributes, attributes.each(read_attribute));
  std::vector<std::string> names;
  for (const SeriesIndex::Attribute& attribute : index.attributes) names.push_back(attribute.name);
  if (const auto duplicate = find_duplicate(std::move(names)))
    return attributes.wrong("\"{}\" is there twice", *duplicate);
  return index;
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
  auto index = read_json(text, read_index, max_nesting);
  return index ? index : fail_in("not the index of a time series", index.error());
}

}  // namespace splatvol::format
