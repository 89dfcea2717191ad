#include "tools/steps.h"

#include <charconv>
#include <limits>

#include "base/addresses.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

bool parse_number(const std::string& text, std::size_t& number) {
  if (text.empty()) return true;
  const char* last = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), last, number);
  return parsed.ec == std::errc{} && parsed.ptr == last;
}

}  // namespace

Result<StepRange> parse_steps(const std::string& text, std::size_t count) {
  StepRange range{0, count - 1};
  const std::size_t colon = text.find(':');
  if (text != "all" && (colon == std::string::npos || !parse_number(text.substr(0, colon), range.first) ||
                        !parse_number(text.substr(colon + 1), range.last)))
    return fail(ErrorCode::invalid_argument, "'{}' is neither \"all\" nor two numbers of steps such as 0:9", text);
  if (range.first > range.last || range.last >= count)
    return fail(ErrorCode::invalid_argument, "no steps {}; the last is {}", text, count - 1);
  return range;
}

std::string check_step_range(const std::string& text) {
  const auto range = parse_steps(text, std::numeric_limits<std::size_t>::max());
  return range ? "" : range.error().message;
}

void add_file_argument(CommandLine& app, std::string& file) {
  app.add_option("file", file,
                 "The file, the index of a series of files (.svols), or its address (http://, https:// or ssh://)")
      ->required()
      ->type_name("FILE.svol|URL");
}

void add_step_options(CommandLine& app, StepChoice& choice) {
  auto* time =
      app.add_option("--time", choice.time, "Of a time series: the step nearest to this time (default: the last)")
          ->type_name("T")
          ->check(check_finite);
  app.add_option("--step", choice.step, "Of a time series: the step of this number, from 0")
      ->type_name("N")
      ->not_negative()
      ->excludes(time);
}

Result<format::Steps> open_steps(const std::string& path) { return format::Steps::open(path, open_file_or_url); }

Result<std::size_t> find_step(const format::Steps& steps, const StepChoice& choice) {
  const std::vector<double>& times = steps.times();
  if (times.empty() && !choice.time && !choice.step) return std::size_t{0};
  if (times.empty()) return fail(ErrorCode::invalid_argument, "{}: no time series, so it has no steps", steps.name());
  if (choice.step && *choice.step >= times.size())
    return fail(ErrorCode::invalid_argument, "{}: no step {}; the last is {}", steps.name(), *choice.step,
                steps.last());
  if (choice.step) return *choice.step;
  return choice.time ? steps.nearest(*choice.time) : steps.last();
}

void tell_nearest(const std::string& name, const format::Steps& steps, const StepChoice& choice, std::size_t step) {
  if (choice.time && steps.times()[step] != *choice.time)
    print_out("{}: time {} is the nearest to {}\n", name, steps.times()[step], *choice.time);
}

Result<std::shared_ptr<const format::Volume>> open_step(const std::string& path, const StepChoice& choice) {
  SPLATVOL_TRY_ASSIGN(steps, open_steps(path));
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, choice));
  return steps.volume(step);
}

}  // namespace splatvol
