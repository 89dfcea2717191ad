#include "builder/series/series_files.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/locked_file.h"
#include "base/temporary_names.h"
#include "builder/sources/array_attributes.h"
#include "format/series_index.h"
#include "format/volume.h"

namespace splatvol {
namespace {

using format::SeriesIndex;

// The name of a step's file. The destructor removes the file, unless an index names it.
class StepFile {
 public:
  /// Chooses a temporary name beside the index.
  explicit StepFile(const std::string& index) : path_(temporary_name_beside(index)) { note_temporary(path_); }
  StepFile(StepFile&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  StepFile& operator=(StepFile&&) = delete;
  ~StepFile() {
    if (path_.empty()) return;
    (void)uninterrupted([&] { return ::unlink(path_.c_str()); });
    forget_temporary(path_);
  }

  [[nodiscard]] const std::string& path() const { return path_; }

  /// Renames the file. Returns false if another has this name.
  Result<bool> rename(std::string path) {
    SPLATVOL_TRY_ASSIGN(renamed, rename_if_free(path_, path));
    if (!renamed) return false;
    forget_temporary(path_);  // from now on, a signal leaves the file: the index may name it at any moment
    path_ = std::move(path);
    return true;
  }

  void keep() { path_.clear(); }

 private:
  std::string path_;
};

struct BuiltStep {
  std::string input;           // for messages
  std::optional<double> time;  // that the input states
  std::vector<format::Attribute> attributes;
  StepFile file;
};

Result<SeriesIndex> read_index(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  auto index = format::series_index_from_json(text);
  if (!index) return fail_in(path, index.error());
  return index;
}

// Returns the time of the next step of an index.
Result<double> next_time(const SeriesIndex& index, const std::string& input, const std::optional<double>& stated) {
  const double last = index.steps.empty() ? -1 : index.steps.back().time;
  const double time = stated.value_or(std::floor(last) + 1);
  if (index.steps.empty() || time > last) return time;
  return fail(ErrorCode::invalid_data, "{}: the time {} is not behind {}, the time of the step before", input, time,
              last);
}

template <class Attribute>
std::vector<std::string> names_of(const std::vector<Attribute>& attributes) {
  std::vector<std::string> names;
  for (const Attribute& attribute : attributes) names.push_back(attribute.name);
  return names;
}

// An index lists the attributes that all steps have, their units, and their ranges over all steps.
Status add_ranges(SeriesIndex& index, const std::vector<format::Attribute>& attributes, const std::string& input) {
  if (index.steps.empty())
    for (const format::Attribute& attribute : attributes)
      index.attributes.push_back({attribute.name, attribute.unit, {attribute.min, attribute.max}});
  SPLATVOL_TRY(match_attributes(input, names_of(attributes), "the steps before", names_of(index.attributes)));
  for (SeriesIndex::Attribute& attribute : index.attributes) {
    const format::Attribute& of_step = *std::ranges::find(attributes, attribute.name, &format::Attribute::name);
    if (of_step.unit != attribute.unit)
      return fail(ErrorCode::invalid_data,
                  "{}: the unit of \"{}\" is \"{}\", and \"{}\" in the steps before: give the right one by --unit",
                  input, attribute.name, of_step.unit, attribute.unit);
    format::include(attribute.range, of_step.min, of_step.max);
  }
  return {};
}

// Adds a step to an index, without the name of its file.
Status add_step(SeriesIndex& index, const BuiltStep& step) {
  SPLATVOL_TRY_ASSIGN(time, next_time(index, step.input, step.time));
  SPLATVOL_TRY(add_ranges(index, step.attributes, step.input));
  index.steps.push_back({time, ""});
  return {};
}

class FilesBuild {
 public:
  FilesBuild(const std::string& output, bool append, const BuildOptions& options, const BuildProgress& progress)
      : output_(output), append_(append), options_(options), progress_(progress) {}

  Result<SeriesReport> run(const std::vector<SeriesStep>& steps) {
    // What can be refused is refused before hours of work.
    if (append_)
      SPLATVOL_TRY(lock_index());
    else
      SPLATVOL_TRY(check_free(steps.size()));
    for (const SeriesStep& step : steps) SPLATVOL_TRY(build_step(step));
    SPLATVOL_TRY(put_in_place());
    return std::move(report_);
  }

 private:
  // Other programs may append meanwhile, while no lock is held.
  Status build_step(const SeriesStep& step) {
    SPLATVOL_TRY_ASSIGN(source, step.open());
    const std::optional<double> stated = step.time ? step.time : source->stated_time();
    if (!has_times_) has_times_ = stated.has_value();
    if (*has_times_ != stated.has_value())
      return fail(ErrorCode::invalid_data, "{}: {}", step.name,
                  stated ? "states a time, and earlier steps do not" : "states no time, and earlier steps do");
    SPLATVOL_TRY(next_time(index_, step.name, stated));

    BuiltStep built{step.name, stated, {}, StepFile(output_)};
    BuildOptions options = options_;
    options.inputs = {step.name};
    options.join_attributes = false;  // what is the same in a step need not be the same in others
    SPLATVOL_TRY(match_attributes(*source, step.name, options));
    auto report = build_volume(*source, built.file.path(), options, progress_);
    if (!report) return fail_by_index_name(std::move(report.error()), built.file.path());
    SPLATVOL_TRY_ASSIGN(file, open_file(built.file.path()));
    SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(file)));
    built.attributes = volume->info().attributes;
    SPLATVOL_TRY(add_step(index_, built));
    built_.push_back(std::move(built));

    const std::uint64_t bytes = report_.build.file_bytes + report->file_bytes;
    add_report(report_, *report, source->conversions());
    report_.build.file_bytes = bytes;
    return {};
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

  // A user does not know the temporary name.
  tl::unexpected<Error> fail_by_index_name(Error error, const std::string& temporary) const {
    const std::size_t at = error.message.find(temporary);
    if (at != std::string::npos) error.message.replace(at, temporary.size(), output_);
    return tl::unexpected(std::move(error));
  }

  // Locks the index, and reads it.
  Result<LockedFile> lock_index() {
    SPLATVOL_TRY_ASSIGN(lock, LockedFile::open(output_, LockedFile::IfTaken::wait));
    SPLATVOL_TRY_SET(index_, read_index(output_));
    return lock;
  }

  // Gives the files of the steps their names, and then names them in the index. If this fails before the index has its
  // name, all is as before; afterwards, nothing is removed.
  Status put_in_place() {
    const std::string folder = folder_of(output_);
    std::optional<LockedFile> lock;
    if (append_) {
      SPLATVOL_TRY_ASSIGN(locked, lock_index());
      lock.emplace(std::move(locked));
      for (const BuiltStep& built : built_) SPLATVOL_TRY(add_step(index_, built));
    }
    if (lock && !lock->is_locked()) report_.warnings.push_back(without_lock_warning(output_));
    const std::size_t before = index_.steps.size() - built_.size();
    for (std::size_t s = 0; s < built_.size(); ++s) {
      SPLATVOL_TRY(name_file(built_[s].file, index_.steps[before + s]));
      report_.times.push_back(index_.steps[before + s].time);
    }
    SPLATVOL_TRY(sync_folder(folder));  // no power cut leaves an index without its files

    SPLATVOL_TRY_ASSIGN(index, AtomicFile::create(output_));
    const std::string text = format::to_json(index_);
    SPLATVOL_TRY(index.append(std::as_bytes(std::span(text))));
    SPLATVOL_TRY(index.commit_unconfirmed());
    for (BuiltStep& built : built_) built.file.keep();
    const Status confirmed = sync_folder(folder);
    if (confirmed) return {};
    return fail(ErrorCode::io,
                "{}: has the steps, though the disk has not confirmed it: check it by svinfo --verify, and do not "
                "append them again: {}",
                output_, confirmed.error().message);
  }

  // Gives a file the first free number behind those of the index.
  Status name_file(StepFile& file, SeriesIndex::Step& step) {
    const std::uint64_t first = next_number();
    for (std::uint64_t number = first;; ++number) {
      SPLATVOL_TRY_ASSIGN(renamed, file.rename(path_of(number)));
      if (!renamed && !append_) return fail_taken(number);
      if (!renamed) continue;
      step.file = name_of(number);
      if (number > first)
        report_.warnings.push_back(fmt::format("{}: is there already, though no step of {}: the step at {} is {}",
                                               path_of(first), output_, step.time, step.file));
      return {};
    }
  }

  // One more than the number of steps, and than every number in their names.
  [[nodiscard]] std::uint64_t next_number() const {
    std::uint64_t next = 0;
    for (const SeriesIndex::Step& step : index_.steps) {
      if (step.file.empty()) break;
      std::uint32_t number = 0;
      const std::string& name = step.file;
      const std::string prefix = stem() + "-";
      if (name.starts_with(prefix)) std::from_chars(name.data() + prefix.size(), name.data() + name.size(), number);
      next = std::max(next, std::uint64_t{number}) + 1;
    }
    return next;
  }

  Status check_free(std::size_t steps) const {
    for (std::size_t number = 0; number < steps; ++number)
      if (std::filesystem::exists(path_of(number))) return fail_taken(number);
    return {};
  }

  tl::unexpected<Error> fail_taken(std::uint64_t number) const {
    return fail(ErrorCode::io, "{}: exists already: remove it, or choose another name for {}", path_of(number),
                output_);
  }

  std::string stem() const { return std::filesystem::path(output_).stem().string(); }
  std::string name_of(std::uint64_t number) const { return fmt::format("{}-{:04}.svol", stem(), number); }
  std::string path_of(std::uint64_t number) const {
    return (std::filesystem::path(output_).parent_path() / name_of(number)).string();
  }

  const std::string& output_;
  bool append_;
  const BuildOptions& options_;
  const BuildProgress& progress_;
  SeriesIndex index_;  // with the steps that are built
  std::optional<bool> has_times_;
  std::map<std::string, int> components_;  // Source::components() of the first step that has the attribute
  std::vector<BuiltStep> built_;
  SeriesReport report_;
};

}  // namespace

Result<SeriesReport> build_series_of_files(const std::vector<SeriesStep>& steps, const std::string& output, bool append,
                                           const BuildOptions& options, const BuildProgress& progress) {
  if (!format::is_series_index(output))
    return fail(ErrorCode::invalid_argument, "{}: the index of a series of files is called NAME.svols", output);
  return FilesBuild(output, append, options, progress).run(steps);
}

}  // namespace splatvol
