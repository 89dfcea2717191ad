#include "builder/series/series_build.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "base/file.h"
#include "base/locked_file.h"
#include "base/temp_file.h"
#include "builder/cells/cell_section.h"
#include "builder/cells/step_summaries.h"
#include "builder/pipeline/census_lines.h"
#include "builder/pipeline/checking.h"
#include "builder/pipeline/describe.h"
#include "builder/pipeline/memory_plan.h"
#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_boundary.h"
#include "builder/pipeline/store_cells.h"
#include "builder/sources/array_attributes.h"
#include "format/cell_reader.h"
#include "format/directory_writer.h"
#include "format/series_writer.h"
#include "format/volume.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

using format::ChunkEntry;
using format::StepWriter;
using format::VolumeInfo;

// Bytes that the build holds for each value of a piece, roughly.
constexpr std::uint64_t value_bytes = 256;
constexpr std::size_t most_steps_together = 64;

using Counts = std::vector<std::pair<std::string, std::uint64_t>>;

void add_counts(const Counts& more, Counts& counts) {
  for (const auto& [name, count] : more) {
    const auto same = std::ranges::find(counts, name, [](const auto& entry) { return entry.first; });
    if (same == counts.end())
      counts.emplace_back(name, count);
    else
      same->second += count;
  }
}

void add_warnings(const std::vector<std::string>& more, std::vector<std::string>& warnings) {
  for (const std::string& warning : more)
    if (std::ranges::find(warnings, warning) == warnings.end()) warnings.push_back(warning);
}

// The chunks of a row, by what they belong to: the file, or one of the steps.
class RowParts {
 public:
  /// `attributes`: of one step.
  RowParts(const VolumeInfo& info, std::size_t attributes, std::size_t steps)
      : info_(info), rows_(info), attributes_(attributes), parts_(1 + steps) {}

  struct Part {
    std::vector<ChunkEntry> entries;
    format::Bytes bytes;
  };

  /// Splits the next row. [0]: of the file; [1 + s]: of step s.
  [[nodiscard]] const std::vector<Part>& split(std::span<const ChunkEntry> entries, std::span<const std::byte> bytes) {
    for (Part& part : parts_) {
      part.entries.clear();
      part.bytes.clear();
    }
    const std::vector<int>& columns = rows_.columns_of_row(next_row_++);
    for (std::size_t c = 0; c < entries.size(); ++c) {
      const int attribute = info_.columns[static_cast<std::size_t>(columns[c])].attribute;
      Part& part = parts_[attribute < 0 ? 0 : 1 + static_cast<std::size_t>(attribute) / attributes_];
      const auto chunk = bytes.first(entries[c].packed_bytes);
      part.entries.push_back(entries[c]);
      part.bytes.insert(part.bytes.end(), chunk.begin(), chunk.end());
      bytes = bytes.subspan(entries[c].packed_bytes);
    }
    return parts_;
  }

 private:
  const VolumeInfo& info_;
  format::RowLayout rows_;
  std::size_t attributes_;
  std::uint64_t next_row_ = 0;
  std::vector<Part> parts_;
};

// The attributes of a series.
std::vector<std::string> names_of(const VolumeInfo& info) {
  std::vector<std::string> names;
  for (const format::SeriesAttribute& attribute : *info.series) names.push_back(attribute.name);
  return names;
}

// Describes what all steps share. Names are as they will be read.
Result<VolumeInfo> describe_series(const VolumeInfo& group, std::span<const std::string> names,
                                   const std::string& provenance) {
  VolumeInfo info = group;
  info.attributes.clear();
  std::erase_if(info.columns, [](const format::Column& column) { return column.attribute >= 0; });
  info.series.emplace();
  for (std::size_t a = 0; a < names.size(); ++a) info.series->push_back({names[a], group.attributes[a].unit});
  info.provenance = provenance;
  SPLATVOL_TRY_ASSIGN(json, format::metadata_to_json(info));
  return format::metadata_from_json(json);
}

// Describes step `s` of a group whose steps have the attributes of `series`.
format::StepInfo describe_step(const VolumeInfo& group, const VolumeInfo& series, std::size_t s) {
  const std::size_t attributes = series.series->size();
  format::StepInfo step;
  for (std::size_t a = 0; a < attributes; ++a) {
    step.attributes.push_back(group.attributes[s * attributes + a]);
    step.attributes.back().name = (*series.series)[a].name;
    step.attributes.back().unit = (*series.series)[a].unit;
  }
  for (format::Column column : group.columns) {
    if (column.attribute < 0 || static_cast<std::size_t>(column.attribute) / attributes != s) continue;
    column.attribute -= static_cast<int>(s * attributes);
    step.columns.push_back(column);
  }
  return step;
}

// The series that steps are written for.
struct Target {
  std::optional<VolumeInfo> info = std::nullopt;           // of the series; none until it is known
  std::optional<std::uint64_t> geometry = std::nullopt;    // format::Volume::geometry_hash()
  std::unique_ptr<format::VolumeWriter> writer = nullptr;  // of a new file, once it is begun
  std::optional<AtomicFile> file = std::nullopt;           // of a new file, until then
  std::vector<std::unique_ptr<StepWriter>> steps = {};
  std::optional<TempFile> section = std::nullopt;             // of the cells of a new file
  std::unique_ptr<const format::CellReader> cells = nullptr;  // once they are known; null: the series keeps none
  std::optional<double> last_time = std::nullopt;             // of the step before; none: there is none
};

class SeriesBuild {
 public:
  SeriesBuild(const BuildOptions& options, std::string folder, const BuildProgress& progress, Target& target,
              double first_number)
      : options_(options), folder_(std::move(folder)), progress_(progress), target_(target), number_(first_number) {
    // Attributes may be equal in all steps of a group, and differ in later steps.
    options_.join_attributes = false;
    // A new file that keeps cells shows where two blocks differ. An append follows the rule of its file.
    blocks_apart_ = target.info ? target.info->cells && target.info->cells->blocks_apart
                                : options.keep_cells && uses_cells(options);
  }

  // Reduces all steps, group by group.
  Result<SeriesReport> run(std::vector<SeriesStep> steps) {
    SeriesReport report;
    SPLATVOL_TRY_ASSIGN(together, count_together(steps.front()));
    for (std::size_t begin = 0; begin < steps.size(); begin += together) {
      const std::size_t end = std::min(steps.size(), begin + together);
      const auto at = [&](std::size_t i) { return steps.begin() + static_cast<std::ptrdiff_t>(i); };
      group_.assign(std::make_move_iterator(at(begin)), std::make_move_iterator(at(end)));
      SPLATVOL_TRY_ASSIGN(built, run_group());
      add_report(report, built.report, built.conversions);
    }
    for (const auto& step : target_.steps) report.times.push_back(step->step().time);
    return report;
  }

 private:
  // Returns how many steps fit into memory together. The first piece of the first step tells how large a step is.
  [[nodiscard]] Result<std::size_t> count_together(const SeriesStep& step) const {
    SPLATVOL_TRY_ASSIGN(source, step.open());
    SPLATVOL_TRY_ASSIGN(piece, source->next());
    const std::uint64_t points = piece ? piece->points.size() : 1;
    const std::uint64_t bytes = std::max<std::uint64_t>(points * source->attributes().size() * value_bytes, 1);
    std::size_t steps = std::clamp<std::size_t>(options_.memory / bytes, 1, most_steps_together);
    const auto least_memory = [&](std::size_t count) {
      return plan_memory(options_.memory, {.attributes = count * source->attributes().size(),
                                           .gradients = options_.gradients,
                                           .index_leaf_points = options_.index_leaf_points})
          .least;
    };
    while (steps > 1 && least_memory(steps) > options_.memory) --steps;
    return steps;
  }

  struct BuiltGroup {
    BuildReport report;
    std::vector<std::string> conversions;
  };

  Result<BuiltGroup> run_group() {
    SPLATVOL_TRY_ASSIGN(source, StepGroup::open(group_, blocks_apart_,
                                                target_.info ? names_of(*target_.info) : std::vector<std::string>()));
    if (target_.file) SPLATVOL_TRY_SET(faces_, start_boundary(*source, options_, folder_));
    SPLATVOL_TRY_SET(cells_, start_cells(*source, options_, folder_));
    RowFiles files(folder_);
    const auto write_group = [&](ReducedSource reduced) { return write(*source, std::move(reduced)); };
    SPLATVOL_TRY_ASSIGN(report,
                        reduce_source(*source, options_, files, folder_, progress_, write_group,
                                      watch_points(*source, options_, faces_.get(), cells_.get()), cells_.get()));
    cells_.reset();
    report.kept_cells = std::exchange(kept_cells_, std::nullopt);
    if (boundary_) {
      report.least_memory = std::max(report.least_memory, boundary_->held_bytes);
      report.boundary = std::move(boundary_->report);
      boundary_.reset();
    }
    return BuiltGroup{std::move(report), source->conversions()};
  }

  // Writes what all steps share, or checks that it is the same as before; then the steps of the group.
  Status write(const StepGroup& source, ReducedSource reduced) {
    const std::vector<std::string>& names = source.step_attributes();
    SPLATVOL_TRY(check_boundary(faces_, options_));
    if (faces_) {
      SPLATVOL_TRY_ASSIGN(boundary, finish_boundary(*faces_, options_, progress_));
      reduced.info.boundary = boundary.packed.info;
      boundary_.emplace(std::move(boundary));
      faces_.reset();
    }
    SPLATVOL_TRY(find_cells(reduced));
    if (!target_.info)
      SPLATVOL_TRY_SET(target_.info, describe_series(reduced.info, names, series_provenance(reduced.report)));
    std::vector<format::SummaryWriter> summaries;
    for (std::size_t s = 0; s < group_.size(); ++s) {
      SPLATVOL_TRY_ASSIGN(writer, format::SummaryWriter::create(folder_));
      summaries.push_back(std::move(writer));
    }
    const auto add_summaries = [&](const format::PageSummaries& of_page) -> Status {
      for (std::size_t s = 0; s < group_.size(); ++s)
        SPLATVOL_TRY(summaries[s].add(std::span(of_page).subspan(s * names.size(), names.size())));
      return {};
    };
    SPLATVOL_TRY_ASSIGN(index, pack_index(reduced, folder_, add_summaries));
    SPLATVOL_TRY_ASSIGN(index_hash, hash_index(index));
    std::vector<std::unique_ptr<StepWriter>> writers;
    SPLATVOL_TRY(create_writers(source, reduced, summaries, writers));
    if (target_.file) {
      SPLATVOL_TRY_ASSIGN(
          writer, format::VolumeWriter::create(std::move(*target_.file), 0, *target_.info, std::move(index), folder_));
      target_.writer = std::move(writer);
      if (boundary_) target_.writer->set_boundary(std::move(boundary_->packed.section));
    }
    SPLATVOL_TRY(write_rows(reduced, writers, index_hash));
    if (reduced.cells) SPLATVOL_TRY(make_section(*reduced.cells));
    options_.keep_cells = target_.info->cells.has_value();
    target_.file.reset();
    if (target_.cells) SPLATVOL_TRY(add_cell_summaries(writers));
    std::ranges::move(writers, std::back_inserter(target_.steps));
    return {};
  }

  // Sorts the cells of the first group, which are written, and compares those of the others.
  Status find_cells(ReducedSource& reduced) {
    const bool is_first = target_.file.has_value();
    if (reduced.cells) {
      progress_("sorting cells", 0);
      SPLATVOL_TRY(is_first ? reduced.cells->sort() : reduced.cells->hash_only());
      if (!is_first || reduced.cells->count() > 0)
        reduced.info.cells = format::CellsInfo{reduced.cells->hash(), blocks_apart_};
    }
    if (!is_first || !reduced.info.cells) reduced.cells = nullptr;
    if (!target_.info || target_.info->cells == reduced.info.cells) return {};
    return fail(ErrorCode::invalid_data, "{}: its cells are not those of the steps before: {}", group_.front().name,
                series_of_files_hint);
  }

  // Makes the section of cells, which stands in front of the steps. Its summaries are theirs.
  Status make_section(MeshCells& cells) {
    SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
    TempFile& section = target_.section.emplace(std::move(file));
    SPLATVOL_TRY_ASSIGN(chunks, target_.writer->chunks());
    const auto append = [&](std::span<const std::byte> bytes) { return section.append(bytes); };
    const auto progress = [&](double fraction) { progress_("writing cells", fraction); };
    SPLATVOL_TRY_SET(kept_cells_, write_cells(cells, chunks, options_.memory / 4, folder_, append, progress));
    target_.writer->set_cells([&section](const std::shared_ptr<const format::ChunkSource>&,
                                         const format::AppendBytes& to) { return format::move_bytes(section, to); });
    const auto read = [&section](std::uint64_t offset, std::uint64_t count) -> Result<format::Bytes> {
      format::Bytes bytes(count);
      SPLATVOL_TRY(section.read(offset, bytes));
      return bytes;
    };
    return open_section(section.size(), read);
  }

  Status open_section(std::uint64_t bytes, const format::CellReader::ReadBytes& read) {
    SPLATVOL_TRY_SET(target_.cells, format::CellReader::open(*target_.info, "cells of the series", bytes, read));
    return {};
  }

  Status add_cell_summaries(std::vector<std::unique_ptr<StepWriter>>& writers) const {
    for (const std::unique_ptr<StepWriter>& writer : writers) {
      progress_("summarizing cells", 0);
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      format::StreamHash hash;
      const auto append = [&](std::span<const std::byte> bytes) {
        hash.add(bytes);
        return file.append(bytes);
      };
      SPLATVOL_TRY(write_step_summaries(*target_.cells, writer->chunks(), writer->step().attributes,
                                        options_.memory / 4, append));
      writer->set_cell_summaries(std::move(file), hash.value());
    }
    return {};
  }

  // The geometry of a file is hashed in the same way (format::Volume::geometry_hash).
  static Result<format::PartsHash> hash_index(const format::PackedIndex& index) {
    format::PartsHash hash;
    format::Bytes part;
    for (std::uint64_t at = 0; at < index.pages.size(); at += part.size()) {
      part.resize(std::min(format::geometry_part_bytes, index.pages.size() - at));
      SPLATVOL_TRY(index.pages.read(at, part));
      hash.add(part);
    }
    const std::span<const std::byte> root = index.root.bytes;
    for (std::uint64_t at = 0; at < root.size(); at += format::geometry_part_bytes)
      hash.add(root.subspan(at, std::min(format::geometry_part_bytes, root.size() - at)));
    return hash;
  }

  Status create_writers(const StepGroup& source, const ReducedSource& reduced,
                        std::vector<format::SummaryWriter>& summaries,
                        std::vector<std::unique_ptr<StepWriter>>& writers) {
    const std::size_t attributes = source.step_attributes().size();
    for (std::size_t s = 0; s < group_.size(); ++s) {
      format::StepInfo step = describe_step(reduced.info, *target_.info, s);
      SPLATVOL_TRY_SET(step.time, time_of(s, source.stated_times()[s]));
      step.provenance = describe_step_provenance(options_.builder, group_[s].name);
      const auto histograms = std::span(reduced.histograms).subspan(s * attributes, attributes);
      SPLATVOL_TRY_ASSIGN(
          writer, StepWriter::create(*target_.info, std::move(step), std::move(summaries[s]), histograms, folder_));
      writers.push_back(std::move(writer));
    }
    return {};
  }

  // Either all steps have a time, or none.
  Result<double> time_of(std::size_t s, std::optional<double> stated) {
    const std::optional<double> time = group_[s].time ? group_[s].time : stated;
    if (!has_times_) has_times_ = time.has_value();
    if (*has_times_ != time.has_value())
      return fail(ErrorCode::invalid_data, "{}: {}", group_[s].name,
                  time ? "states a time, and earlier steps do not" : "states no time, and earlier steps do");
    const double number = time ? *time : number_++;
    if (target_.last_time && !(number > *target_.last_time))
      return fail(ErrorCode::invalid_data, "{}: the time {} is not behind {}, the time of the step before",
                  group_[s].name, number, *target_.last_time);
    target_.last_time = number;
    return number;
  }

  Status write_rows(ReducedSource& reduced, std::vector<std::unique_ptr<StepWriter>>& writers,
                    format::PartsHash index_hash) {
    RowParts parts(reduced.info, target_.info->series->size(), group_.size());
    const bool is_new = target_.file.has_value();
    const auto row_count = static_cast<double>(format::RowLayout(reduced.info).row_count());
    format::PartsHash hash;
    double row = 0;
    const auto write_row = [&](std::span<const ChunkEntry> entries, std::span<const std::byte> bytes) -> Status {
      progress_("writing", ++row / row_count);
      const std::vector<RowParts::Part>& split = parts.split(entries, bytes);
      for (const ChunkEntry& entry : split[0].entries) hash.add(entry.hash);
      if (is_new) SPLATVOL_TRY(target_.writer->append_row(split[0].entries, split[0].bytes));
      for (std::size_t s = 0; s < writers.size(); ++s)
        SPLATVOL_TRY(writers[s]->append_row(split[1 + s].entries, split[1 + s].bytes));
      return {};
    };
    SPLATVOL_TRY(reduced.files.read(reduced.info.resolutions(), write_row));
    hash.add(index_hash.value());
    if (!target_.geometry) target_.geometry = hash.value();
    if (*target_.geometry == hash.value()) return {};
    return fail(ErrorCode::invalid_data,
                "{}: its points and cells are not those of the steps before, or it lacks a value at points of several "
                "pieces that have one there: {}",
                group_.front().name, series_of_files_hint);
  }

  std::string series_provenance(const BuildReport& report) const {
    BuildOptions options = options_;
    options.inputs = {group_.front().name};
    return describe_provenance(options, report);
  }

  BuildOptions options_;
  std::string folder_;
  const BuildProgress& progress_;
  Target& target_;
  std::vector<SeriesStep> group_;
  std::unique_ptr<BoundaryFaces> faces_;    // of the first group, if the file gets a boundary
  std::unique_ptr<MeshCells> cells_;        // of the present group, if the series may keep cells
  std::optional<CellReport> kept_cells_;    // of the first group
  std::optional<StoredBoundary> boundary_;  // of the first group
  bool blocks_apart_;                       // vertices of different blocks are different points
  std::optional<bool> has_times_;
  double number_;  // of the next step without a time
};

// Fails if the steps would not have the attributes of the series, in any order.
Status check_attributes(const format::Volume& volume, const SeriesStep& step) {
  SPLATVOL_TRY_ASSIGN(source, step.open());
  SPLATVOL_TRY(match_attributes(step.name, source->attributes(), volume.name(), names_of(volume.file_info())));
  return {};
}

}  // namespace

void add_report(SeriesReport& series, const BuildReport& steps, const std::vector<std::string>& conversions) {
  BuildReport& all = series.build;
  if (all.resolution_counts.empty()) {
    all = steps;
    all.missing.clear();
    all.fills.clear();
    all.warnings.clear();
    all.lost = {};
    series.conversions = conversions;
  } else {
    for (const std::string& line : conversions)
      if (std::ranges::none_of(series.conversions, [&](const std::string& known) { return line.ends_with(known); }))
        series.conversions.push_back(line);
    all.cells.unwritten += steps.cells.unwritten;
    all.cells.open_ends += steps.cells.open_ends;
    all.cells.losses.insert(steps.cells.losses.begin(), steps.cells.losses.end());
  }
  add_counts(steps.missing, all.missing);
  add_counts(steps.fills, all.fills);
  add_warnings(steps.warnings, all.warnings);
  add_lost(steps.lost, all.lost);
  all.points.unlike = std::max(all.points.unlike, steps.points.unlike);
}

Result<SeriesReport> build_series(std::vector<SeriesStep> steps, const std::string& output, const BuildOptions& options,
                                  const BuildProgress& progress) {
  if (steps.empty()) return fail(ErrorCode::invalid_argument, "no step to build");
  Target target;
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(output));
  target.file.emplace(std::move(file));
  SPLATVOL_TRY_ASSIGN(report,
                      SeriesBuild(options, temp_folder_of(output, options), progress, target, 0).run(std::move(steps)));
  SPLATVOL_TRY(target.writer->finish_series(target.steps, checking(progress)));
  report.build.file_bytes = target.writer->file_bytes();
  return report;
}

Result<SeriesReport> append_to_series(std::vector<SeriesStep> steps, const std::string& path, BuildOptions options,
                                      const BuildProgress& progress) {
  if (steps.empty()) return fail(ErrorCode::invalid_argument, "no step to append");
  SPLATVOL_TRY_ASSIGN(source, open_file(path));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  if (!volume->series())
    return fail(ErrorCode::invalid_argument, "{}: not a time series: build it with --series or --times first", path);
  if (options.boundary_triangles > 0)
    return fail(ErrorCode::invalid_argument,
                "{}: an append does not change the boundary: leave it out, or build the series anew", path);
  SPLATVOL_TRY(check_attributes(*volume, steps.front()));
  const VolumeInfo& info = volume->file_info();
  for (const Reduction reduction : {Reduction::octree, Reduction::mis, Reduction::kdtree})
    if (info.reduction_method == reduction_name(reduction)) options.reduction = reduction;
  options.leaf_points = info.leaf_points;
  options.points_per_chunk.points.assign(info.points_per_chunk.rbegin(), info.points_per_chunk.rend());
  options.exact.positions = info.position_error == 0;
  const auto is_exact = [](const format::Attribute& attribute) { return attribute.error == 0; };
  options.exact.values =
      options.exact.values || (options.exact.positions && std::ranges::all_of(volume->info().attributes, is_exact));
  options.gradients = volume->info().find_column(format::ColumnKind::gradient, 0) >= 0;
  SPLATVOL_TRY_ASSIGN(geometry, volume->geometry_hash());
  Target target{.info = info, .geometry = geometry};
  options.keep_cells = info.cells.has_value();
  SPLATVOL_TRY_SET(target.cells, format::CellReader::open(*volume));
  target.last_time = volume->series()->steps.back().time;
  const double next_number = std::floor(*target.last_time) + 1;
  SPLATVOL_TRY_ASSIGN(
      report, SeriesBuild(options, temp_folder_of(path, options), progress, target, next_number).run(std::move(steps)));
  SPLATVOL_TRY_ASSIGN(appended, format::append_steps(path, *volume, target.steps));
  report.build.file_bytes = appended.file_bytes;
  if (!appended.is_locked) report.warnings.push_back(without_lock_warning(path));
  return report;
}

}  // namespace splatvol
