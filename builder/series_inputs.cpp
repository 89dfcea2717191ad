#include "builder/series_inputs.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "builder/input_files.h"
#include "builder/sources/array_attributes.h"

namespace splatvol {
namespace {

// How many components of a vector are among attributes.
int count_components(const std::vector<std::string>& attributes, const std::string& vector) {
  int count = 0;
  while (std::ranges::find(attributes, fmt::format("{}[{}]", vector, count)) != attributes.end()) ++count;
  return count;
}

bool parse_end(const std::string& text, double& end) {
  if (text.empty()) return true;
  const char* last = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), last, end);
  return parsed.ec == std::errc{} && parsed.ptr == last && std::isfinite(end);
}

}  // namespace

Result<TimeRange> parse_times(const std::string& text) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  TimeRange range{-infinity, infinity};
  if (text == "all") return range;
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos || !parse_end(text.substr(0, colon), range.first) ||
      !parse_end(text.substr(colon + 1), range.last) || !(range.first <= range.last))
    return fail(ErrorCode::invalid_argument, "\"{}\" is neither \"all\" nor two times such as 0:1.5", text);
  return range;
}

Result<std::vector<SeriesStep>> steps_of_input(const std::vector<std::string>& inputs, const SourceOptions& options,
                                               const TimeRange& times, const OpenSource& open) {
  SPLATVOL_TRY_ASSIGN(source, open(inputs, options));
  const auto step = source->time_step();
  if (!step) return fail(ErrorCode::invalid_argument, "{}: no time steps in it to choose from", inputs[0]);
  std::vector<SeriesStep> steps;
  for (const double time : step->times) {
    if (!(time >= times.first && time <= times.last)) continue;
    SourceOptions at_time = options;
    at_time.time = time;
    const std::string name = fmt::format("{} at {}", std::filesystem::path(inputs[0]).filename().string(), time);
    steps.push_back({name, time, [inputs, at_time, open] { return open(inputs, at_time); }});
  }
  if (steps.empty())
    return fail(ErrorCode::invalid_argument, "{}: none of its {} steps is in this range; they reach from {} to {}",
                inputs[0], step->times.size(), step->times.front(), step->times.back());
  return steps;
}

Result<std::vector<SeriesStep>> steps_of_files(const std::vector<std::string>& inputs, const SourceOptions& options,
                                               const OpenSource& open) {
  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  std::vector<SeriesStep> steps;
  for (const std::string& path : paths)
    steps.push_back({std::filesystem::path(path).filename(), std::nullopt,
                     [path, options, open] { return open({path}, options); }});
  return steps;
}

OpenSource open_for_series(OpenSource open, std::string series) {
  return [open = std::move(open), series = std::move(series)](
             const std::vector<std::string>& inputs, const SourceOptions& options) -> Result<std::unique_ptr<Source>> {
    auto opened = open(inputs, options);
    if (!opened && opened.error().code == ErrorCode::invalid_argument)
      return fail(ErrorCode::invalid_argument, "{}: a step that is appended has all attributes of {}",
                  opened.error().message, series);
    SPLATVOL_TRY_ASSIGN(source, std::move(opened));
    const std::vector<std::string>& attributes = source->attributes();
    const std::vector<int> components = source->components();
    for (std::size_t a = 0; a < attributes.size(); ++a)
      if (components[a] > 1 && count_components(attributes, attributes[a]) != components[a])
        return fail(ErrorCode::invalid_data,
                    "{}: \"{}\" is {}, which {} does not have: to append the magnitude, name all attributes of the "
                    "series by --attribute",
                    inputs[0], attributes[a], components_text(components[a]), series);
    return source;
  };
}

}  // namespace splatvol
