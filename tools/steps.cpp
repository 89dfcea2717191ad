#include "tools/steps.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "base/http_source.h"
#include "format/series_index.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_index_bytes = 16u << 20;

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

void add_step_options(CLI::App& app, StepChoice& choice) {
  auto* time =
      app.add_option("--time", choice.time, "Of a time series: the step nearest to this time (default: the last)")
          ->type_name("T")
          ->check(check_finite);
  app.add_option("--step", choice.step, "Of a time series: the step of this number, from 0")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber)
      ->excludes(time);
}

Result<Steps> Steps::open(const std::string& path) {
  Steps steps(path);
  if (format::is_series_index(path)) {
    SPLATVOL_TRY(steps.open_index());
    return steps;
  }
  SPLATVOL_TRY_ASSIGN(source, open_file_or_url(path));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  if (volume->series())
    for (const format::StepEntry& step : volume->series()->steps) steps.times_.push_back(step.time);
  steps.volume_ = std::move(volume);
  return steps;
}

Status Steps::open_index() {
  SPLATVOL_TRY_ASSIGN(source, open_file_or_url(path_));
  if (source->size() > most_index_bytes)
    return fail(ErrorCode::invalid_data, "{}: {} bytes are no index of a time series", path_, source->size());
  std::string text(source->size(), '\0');
  SPLATVOL_TRY(source->read(0, std::as_writable_bytes(std::span(text))));
  const auto index = format::series_index_from_json(text);
  if (!index) return fail_in(path_, index.error());
  const std::string folder = path_.substr(0, path_.find_last_of('/') + 1);  // also of an address; empty without '/'
  for (const format::SeriesIndex::Step& step : index->steps) {
    times_.push_back(step.time);
    files_.push_back(folder + step.file);
  }
  return {};
}

Result<std::size_t> Steps::find(const StepChoice& choice) const {
  if (times_.empty() && !choice.time && !choice.step) return std::size_t{0};
  if (times_.empty()) return fail(ErrorCode::invalid_argument, "{}: no time series, so it has no steps", path_);
  if (choice.step && *choice.step >= times_.size())
    return fail(ErrorCode::invalid_argument, "{}: no step {}; the last is {}", path_, *choice.step, times_.size() - 1);
  if (choice.step) return *choice.step;
  if (!choice.time) return times_.size() - 1;
  const auto nearest = std::ranges::min_element(times_, {}, [&](double time) { return std::abs(time - *choice.time); });
  return static_cast<std::size_t>(nearest - times_.begin());
}

Result<std::shared_ptr<const format::Volume>> Steps::volume(std::size_t step) const {
  if (volume_) return !volume_->series() || volume_->step() == step ? volume_ : volume_->at_step(step);
  SPLATVOL_TRY_ASSIGN(source, open_file_or_url(files_[step]));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  if (volume->series())
    return fail(ErrorCode::invalid_data, "{}: a time series, where {} names a file for one step", files_[step], path_);
  return volume;
}

Result<std::shared_ptr<const format::Volume>> Steps::volume(const StepChoice& choice) const {
  SPLATVOL_TRY_ASSIGN(step, find(choice));
  return volume(step);
}

}  // namespace splatvol
