#include "builder/series/series_inputs.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "builder/opening/input_files.h"
#include "builder/series/series_attributes.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

bool parse_end(const std::string& text, double& end) {
  if (text.empty()) return true;
  end = number_of<double>(text).value_or(std::numeric_limits<double>::quiet_NaN());
  return std::isfinite(end);
}

StepInput step_input(const std::string& name, std::optional<double> time, const std::vector<std::string>& inputs,
                     const SourceOptions& options, const InputReader& reader) {
  return {name, time, options,
          [inputs, open = reader.open](const SourceOptions& chosen) { return open(inputs, chosen); },
          [inputs, list = reader.list](const SourceOptions& chosen) { return list(inputs, chosen); }};
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
                                               const TimeRange& times, const InputReader& reader,
                                               const std::vector<std::string>& series) {
  SPLATVOL_TRY_ASSIGN(source, reader.open(inputs, options));
  const auto step = source->time_step();
  if (!step) return fail(ErrorCode::invalid_argument, "{}: no time steps in it to choose from", inputs[0]);
  std::vector<StepInput> steps;
  for (const double time : step->times) {
    if (!(time >= times.first && time <= times.last)) continue;
    SourceOptions at_time = options;
    at_time.time = time;
    const std::string name = fmt::format("{} at {}", std::filesystem::path(inputs[0]).filename().string(), time);
    steps.push_back(step_input(name, time, inputs, at_time, reader));
  }
  if (steps.empty())
    return fail(ErrorCode::invalid_argument, "{}: none of its {} steps is in this range; they reach from {} to {}",
                inputs[0], step->times.size(), step->times.front(), step->times.back());
  return make_steps(std::move(steps), series);
}

Result<std::vector<SeriesStep>> steps_of_files(const std::vector<std::string>& inputs, const SourceOptions& options,
                                               const InputReader& reader, const std::vector<std::string>& series) {
  SPLATVOL_TRY_ASSIGN(paths, expand_folders(inputs));
  std::vector<StepInput> steps;
  for (const std::string& path : paths)
    steps.push_back(step_input(std::filesystem::path(path).filename(), std::nullopt, {path}, options, reader));
  return make_steps(std::move(steps), series);
}

}  // namespace splatvol
