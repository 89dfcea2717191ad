#include "format/steps.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "format/series_index.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t most_index_bytes = 16u << 20;

// The query of an address, with its question mark, such as a token that all files there need; empty for a path.
std::string query_of(const std::string& path) {
  const std::size_t query =
      path.starts_with("http") && path.find("://") != std::string::npos ? path.find('?') : path.npos;
  return query == path.npos ? std::string() : path.substr(query);
}

// Requires that the file has it.
const Attribute& attribute_of(const Volume& volume, const std::string& name) {
  return volume.info().attributes[static_cast<std::size_t>(volume.info().find_attribute(name))];
}

}  // namespace

Result<Steps> Steps::open(const std::string& path, OpenFile open) {
  Steps steps(path, std::move(open));
  if (is_series_index(std::string_view(path).substr(0, path.size() - query_of(path).size()))) {
    SPLATVOL_TRY(steps.open_index());
    return steps;
  }
  SPLATVOL_TRY_ASSIGN(source, steps.open_(path));
  SPLATVOL_TRY_ASSIGN(volume, Volume::open(std::move(source)));
  for (const Attribute& attribute : volume->info().attributes) {
    steps.names_.push_back(attribute.name);
    steps.ranges_.push_back({attribute.min, attribute.max});
  }
  if (volume->series()) {
    for (const StepEntry& step : volume->series()->steps) steps.times_.push_back(step.time);
    steps.ranges_ = volume->series()->ranges;
  }
  steps.name_ = volume->name();
  steps.volume_ = std::move(volume);
  return steps;
}

std::size_t Steps::nearest(double time) const {
  const auto after = std::ranges::lower_bound(times_, time);
  if (after == times_.begin()) return 0;
  const bool is_before_nearer = after == times_.end() || time - *(after - 1) <= *after - time;
  return static_cast<std::size_t>(after - times_.begin()) - (is_before_nearer ? 1 : 0);
}

Status Steps::open_index() {
  SPLATVOL_TRY_ASSIGN(source, open_(path_));
  name_ = source->name();
  if (source->size() > most_index_bytes)
    return fail(ErrorCode::invalid_data, "{}: {} bytes are no index of a time series", name_, source->size());
  std::string text(static_cast<std::size_t>(source->size()), '\0');
  SPLATVOL_TRY(source->read(0, std::as_writable_bytes(std::span(text))));
  const auto index = series_index_from_json(text);
  if (!index) return fail_in(name_, index.error());
  const std::string query = query_of(path_);
  const std::string plain = path_.substr(0, path_.size() - query.size());
  const std::string folder = plain.substr(0, plain.find_last_of('/') + 1);  // also of an address; empty without '/'
  for (const SeriesIndex::Step& step : index->steps) {
    times_.push_back(step.time);
    files_.push_back(fmt::format("{}{}{}", folder, step.file, query));
  }
  for (const SeriesIndex::Attribute& attribute : index->attributes) {
    names_.push_back(attribute.name);
    units_.push_back(attribute.unit);
    ranges_.push_back(attribute.range);
  }
  return {};
}

// The index names the attributes that all of its files have.
Status Steps::check_attributes(const Volume& volume) const {
  for (const std::string& name : names_)
    if (volume.info().find_attribute(name) < 0)
      return fail(ErrorCode::invalid_data, "{}: lacks the attribute '{}' that {} lists", volume.name(), name, name_);
  return {};
}

Result<std::shared_ptr<const Volume>> Steps::volume(std::size_t step) const {
  if (volume_) return !volume_->series() || volume_->step() == step ? volume_ : volume_->at_step(step);
  if (step >= files_.size()) return fail(ErrorCode::invalid_argument, "{}: no step {}", name_, step);
  SPLATVOL_TRY_ASSIGN(source, open_(files_[step]));
  SPLATVOL_TRY_ASSIGN(volume, Volume::open(std::move(source)));
  if (volume->series())
    return fail(ErrorCode::invalid_data, "{}: a time series, where {} names a file for one step", volume->name(),
                name_);
  SPLATVOL_TRY(check_attributes(*volume));
  return volume;
}

Status Steps::check_units(const Volume& volume) const {
  for (std::size_t a = 0; a < names_.size(); ++a) {
    const std::string& unit = attribute_of(volume, names_[a]).unit;
    if (unit != units_[a])
      return fail(ErrorCode::invalid_data, "{}: the unit of '{}' is \"{}\", but {} says \"{}\"", volume.name(),
                  names_[a], unit, name_, units_[a]);
  }
  return {};
}

Status Steps::verify(const std::function<void(double)>& progress, std::size_t threads) const {
  if (volume_) return volume_->verify(progress, threads);
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  std::vector<StepRange> ranges(names_.size(), StepRange{none, none});
  for (std::size_t step = 0; step < files_.size(); ++step) {
    SPLATVOL_TRY_ASSIGN(volume, this->volume(step));
    SPLATVOL_TRY(check_units(*volume));
    const auto of_step = [&](double share) {
      progress((static_cast<double>(step) + share) / static_cast<double>(files_.size()));
    };
    SPLATVOL_TRY(volume->verify(of_step, threads));
    for (std::size_t a = 0; a < names_.size(); ++a) {
      const Attribute& attribute = attribute_of(*volume, names_[a]);
      include(ranges[a], attribute.min, attribute.max);
    }
  }
  for (std::size_t a = 0; a < names_.size(); ++a)
    if (!is_same(ranges[a], ranges_[a]))
      return fail(ErrorCode::invalid_data, "{}: the range of '{}' is not that of the steps, {} to {}", name_, names_[a],
                  ranges[a].min, ranges[a].max);
  return {};
}

StepRange Steps::range_of(const std::string& attribute) const {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  const auto found = std::ranges::find(names_, attribute);
  return found == names_.end() ? StepRange{none, none} : ranges_[static_cast<std::size_t>(found - names_.begin())];
}

}  // namespace splatvol::format
