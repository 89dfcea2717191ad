#include "builder/series_files.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "base/file.h"
#include "builder/sources/array_attributes.h"
#include "format/series_index.h"
#include "format/volume.h"

namespace splatvol {
namespace {

using format::SeriesIndex;

class FilesBuild {
 public:
  FilesBuild(const std::string& output, SeriesIndex index, const BuildOptions& options, const BuildProgress& progress)
      : output_(output), index_(std::move(index)), options_(options), progress_(progress) {}

  Result<SeriesReport> run(const std::vector<SeriesStep>& steps) {
    auto report = build_all(steps);
    if (report) return report;
    std::error_code error;
    for (const std::string& path : written_) std::filesystem::remove(path, error);
    return tl::unexpected(report.error());
  }

 private:
  Result<SeriesReport> build_all(const std::vector<SeriesStep>& steps) {
    SeriesReport report;
    std::uint64_t bytes = 0;
    for (const SeriesStep& step : steps) {
      SPLATVOL_TRY_ASSIGN(built, build_step(step));
      bytes += built.report.file_bytes;
      add_report(report, built.report, built.conversions);
      report.times.push_back(index_.steps.back().time);
    }
    report.build.file_bytes = bytes;
    SPLATVOL_TRY(write_text_file(output_, format::to_json(index_)));
    return report;
  }

  struct BuiltStep {
    BuildReport report;
    std::vector<std::string> conversions;
  };

  Result<BuiltStep> build_step(const SeriesStep& step) {
    SPLATVOL_TRY_ASSIGN(source, step.open());
    const std::optional<double> stated = step.time ? step.time : source->stated_time();
    if (!has_times_) has_times_ = stated.has_value();
    if (*has_times_ != stated.has_value())
      return fail(ErrorCode::invalid_data, "{}: {}", step.name,
                  stated ? "states a time, and earlier steps do not" : "states no time, and earlier steps do");
    const double last = index_.steps.empty() ? -1 : index_.steps.back().time;
    const double time = stated.value_or(std::floor(last) + 1);
    if (!index_.steps.empty() && !(time > last))
      return fail(ErrorCode::invalid_data, "{}: the time {} is not behind {}, the time of the step before", step.name,
                  time, last);

    const std::filesystem::path index_path(output_);
    const std::string file = fmt::format("{}-{:04}.svol", index_path.stem().string(), index_.steps.size());
    const std::string path = (index_path.parent_path() / file).string();
    if (std::filesystem::exists(path))
      return fail(ErrorCode::io, "{}: exists already: remove it, or choose another name for {}", path, output_);
    BuildOptions options = options_;
    options.inputs = {step.name};
    options.join_attributes = false;  // what is the same in a step need not be the same in others
    SPLATVOL_TRY(match_attributes(*source, step.name, options));
    SPLATVOL_TRY_ASSIGN(report, build_volume(*source, path, options, progress_));
    written_.push_back(path);
    SPLATVOL_TRY(add_ranges(path, step.name));
    index_.steps.push_back({time, file});
    return BuiltStep{std::move(report), source->conversions()};
  }

  // A vector's magnitude is no number of a scalar. A step that tells no unit has that of the steps before.
  Status match_attributes(const Source& source, const std::string& name, BuildOptions& options) {
    const std::vector<std::string>& attributes = source.attributes();
    const std::vector<std::string> units = source.units();
    const std::vector<int> components = source.components();
    std::vector<int> expected;
    for (std::size_t a = 0; a < attributes.size(); ++a) {
      expected.push_back(components_.try_emplace(attributes[a], components[a]).first->second);
      const auto known = std::ranges::find(index_.attributes, attributes[a], &SeriesIndex::Attribute::name);
      if (units[a].empty() && known != index_.attributes.end())
        options.units.emplace(options.units.begin(), attributes[a], known->unit);
    }
    return check_components(name, attributes, components, "the steps before", expected);
  }

  // The index lists the attributes that all steps have, their units, and their ranges over all steps.
  Status add_ranges(const std::string& path, const std::string& name) {
    SPLATVOL_TRY_ASSIGN(source, open_file(path));
    SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
    const std::vector<format::Attribute>& attributes = volume->info().attributes;
    if (index_.steps.empty())
      for (const format::Attribute& attribute : attributes)
        index_.attributes.push_back({attribute.name, attribute.unit, {attribute.min, attribute.max}});
    if (!std::ranges::is_permutation(attributes, index_.attributes, {}, &format::Attribute::name,
                                     &SeriesIndex::Attribute::name))
      return fail(ErrorCode::invalid_data,
                  "{}: its attributes are not those of the steps before: choose common ones by --attribute", name);
    for (SeriesIndex::Attribute& attribute : index_.attributes) {
      const format::Attribute& of_step =
          attributes[static_cast<std::size_t>(volume->info().find_attribute(attribute.name))];
      if (of_step.unit != attribute.unit)
        return fail(ErrorCode::invalid_data,
                    "{}: the unit of \"{}\" is \"{}\", and \"{}\" in the steps before: give the right one by --unit",
                    name, attribute.name, of_step.unit, attribute.unit);
      format::include(attribute.range, of_step.min, of_step.max);
    }
    return {};
  }

  const std::string& output_;
  SeriesIndex index_;
  const BuildOptions& options_;
  const BuildProgress& progress_;
  std::optional<bool> has_times_;
  std::map<std::string, int> components_;  // Source::components() of the first step that has the attribute
  std::vector<std::string> written_;
};

Result<SeriesIndex> read_index(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  auto index = format::series_index_from_json(text);
  if (!index) return fail_in(path, index.error());
  return index;
}

}  // namespace

Result<SeriesReport> build_series_of_files(const std::vector<SeriesStep>& steps, const std::string& output, bool append,
                                           const BuildOptions& options, const BuildProgress& progress) {
  if (!format::is_series_index(output))
    return fail(ErrorCode::invalid_argument, "{}: the index of a series of files is called NAME.svols", output);
  SeriesIndex index;
  if (append) {
    SPLATVOL_TRY_ASSIGN(old, read_index(output));
    index = std::move(old);
  }
  return FilesBuild(output, std::move(index), options, progress).run(steps);
}

}  // namespace splatvol
