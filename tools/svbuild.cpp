// svbuild: a mesh or a point set in, a .svol file out.
#include <fmt/ranges.h>
#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/scalable_allocator.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>

#include "base/byte_text.h"
#include "base/file.h"
#include "base/input_formats.h"
#include "base/json.h"
#include "base/printable.h"
#include "base/temp_file.h"
#include "builder/cache/input_state.h"
#include "builder/opening/open_own.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/census_lines.h"
#include "builder/pipeline/estimate.h"
#include "builder/pipeline/preview.h"
#include "builder/series/series_build.h"
#include "builder/series/series_files.h"
#include "builder/series/series_inputs.h"
#include "builder/sources/openfoam/foam_up.h"
#include "format/steps.h"
#include "tools/build_share.h"
#include "tools/cells_option.h"
#include "tools/reading.h"
#include "tools/svbuild_cached.h"
#include "tools/svbuild_ranks.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

struct Options {
  std::vector<std::string> inputs;
  std::string output;
  std::vector<std::string> attributes;
  std::string reduction = "octree";
  std::uint32_t leaf = 8;
  std::string connectivity = "auto";
  std::string memory;
  std::string temp_folder;
  std::vector<std::string> columns;
  std::optional<double> time;
  bool gradients = false;
  bool exact = false;
  bool strict = false;
  bool no_displacements = false;
  bool boundary = false;
  bool boundary_if_any = false;
  bool drop_cells = false;
  std::uint64_t boundary_triangles = 0;  // 0: the default, if there is a boundary
  std::string cells = "averaged";
  std::string up;  // x, y, z; empty: as is usual for the input
  std::vector<double> missing;
  std::string times;  // empty: one step
  bool series = false;
  bool series_of_files = false;
  bool append = false;
  bool estimate = false;
  std::vector<std::string> units;
  unsigned threads = default_threads();
  ReadingOptions reading;
  bool json = false;
  CacheOptions cache;
};

constexpr std::uint64_t usual_boundary_triangles = 200000;
constexpr double boundary_triangle_bytes = 6;  // in the file
constexpr double most_turned_volume = 1e-4;    // of the mesh's volume, without a warning

rusage usage_of(int who) {
  rusage usage{};
  ::getrusage(who, &usage);
  return usage;
}

// `who`: as getrusage takes it. Children count once they have ended.
double processor_seconds(int who) {
  const rusage usage = usage_of(who);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

struct StageTime {
  std::string stage;
  double seconds = 0, processor_seconds = 0;
};

// Follows a build, and shows how far it is. Notes the time of each stage. Thread-safe.
class Stages {
 public:
  explicit Stages(ShowShare show) : show_(std::move(show)) {}

  void update(const char* stage, double fraction) {
    const std::lock_guard lock(mutex_);
    if (stage_ != stage) {
      note_time();
      stage_ = stage;
      scalable_allocation_command(TBBMALLOC_CLEAN_ALL_BUFFERS,
                                  nullptr);  // the last stage's memory is of no use to this
    }
    share_.update(stage, fraction);
    show_(share_.state());
  }

  // The reader process has read this share of its inputs.
  void read(double share) {
    const std::lock_guard lock(mutex_);
    share_.read(share);
    show_(share_.state());
  }

  void set_kind(BuildKind kind) { share_.set_kind(kind); }

  // Lets each step tell when it is opened.
  void watch(std::vector<SeriesStep>& steps) {
    share_.set_steps(steps.size());
    for (std::size_t i = 0; i < steps.size(); ++i)
      steps[i].open = [this, i, open = std::move(steps[i].open)] {
        share_.open_step(i);
        return open();
      };
  }

  // All times until now, in the order in which the stages began.
  [[nodiscard]] std::vector<StageTime> times() {
    const std::lock_guard lock(mutex_);
    note_time();
    return times_;
  }

 private:
  // Each step of a series has all stages: their times add up.
  void note_time() {
    auto time = std::ranges::find(times_, stage_, &StageTime::stage);
    if (time == times_.end()) time = times_.insert(time, {.stage = stage_});
    const double now = seconds_now(), processor_now = processor_seconds(RUSAGE_SELF);
    time->seconds += now - start_;
    time->processor_seconds += processor_now - processor_start_;
    start_ = now;
    processor_start_ = processor_now;
  }

  std::mutex mutex_;
  ShowShare show_;
  BuildShare share_;
  std::string stage_ = "reading";  // inputs are opened before the first call of update()
  double start_ = seconds_now(), processor_start_ = processor_seconds(RUSAGE_SELF);
  std::vector<StageTime> times_;
};

// Shows a bar on the terminal until the last copy is gone.
ShowShare terminal_bar() {
  return [bar = std::make_shared<ProgressBar>("reading")](const BuildShare::State& state) {
    bar->rename(state.stage);
    bar->update(state.share);
  };
}

// Notes on the input that the report repeats.
struct InputNotes {
  std::uint64_t memory = 0;              // BuildOptions::memory
  std::optional<TimeStep> step;          // that was taken of several
  std::vector<double> times;             // of a series
  std::vector<std::string> conversions;  // Source::conversions()
  std::vector<std::string> warnings;     // about the file or the files, not about the input
  JointWork work = {};                   // of several processes
  std::vector<StageTime> stages = {};    // of this process
};

void print_json(const Options& options, const InputNotes& notes, const BuildReport& report, double seconds) {
  nlohmann::ordered_json census = nlohmann::ordered_json::object();
  for (const CensusLine& line : census_lines(report)) census[line.words] = line.count;
  const double of_processors = processor_seconds(RUSAGE_SELF) + processor_seconds(RUSAGE_CHILDREN);
  nlohmann::ordered_json document = {{"output", options.output},
                                     {"points", report.resolution_counts.back()},
                                     {"resolutions", report.resolution_counts},
                                     {"connectivity", connectivity_name(report.connectivity)},
                                     {"file_bytes", report.file_bytes},
                                     {"seconds", seconds},
                                     {"processor_seconds", of_processors},
                                     {"census", census}};
  if (notes.memory < report.least_memory) document["memory_held_beyond_limit"] = report.least_memory;
  for (const auto& lines : {warning_lines(report), notes.warnings})
    for (const std::string& warning : lines) document["warnings"].push_back(warning);
  if (!notes.conversions.empty()) document["conversions"] = notes.conversions;
  for (const auto& [name, same] : report.aliases) document["aliases"].push_back({{"name", name}, {"same_as", same}});
  if (notes.step)
    document["time_step"] = {
        {"time", notes.step->time}, {"number", notes.step->index + 1}, {"of", notes.step->times.size()}};
  if (notes.step && options.time) document["time_step"]["asked"] = *options.time;
  if (!notes.times.empty()) document["times"] = notes.times;
  if (const auto& boundary = report.boundary) {
    document["boundary"] = {{"triangles", boundary->triangles},
                            {"kept", boundary->kept},
                            {"error", boundary->error},
                            {"bytes", boundary->bytes},
                            {"patches", nlohmann::ordered_json::array()}};
    for (const auto& [name, triangles] : boundary->patches)
      document["boundary"]["patches"].push_back({{"name", name}, {"triangles", triangles}});
  }
  if (const auto& cells = report.kept_cells)
    document["cells"] = {{"kept", cells->cells},
                         {"collapsed", cells->collapsed},
                         {"turned", cells->turned},
                         {"turned_volume", cells->volume > 0 ? cells->turned_volume / cells->volume : 0},
                         {"bytes", cells->bytes}};
  for (const StageTime& time : notes.stages)
    document["stages"][time.stage] = {{"seconds", time.seconds}, {"processor_seconds", time.processor_seconds}};
  const JointWork& work = notes.work;
  if (work.ranks > 1)
    document["ranks"] = {
        {"count", work.ranks},           {"ranges", work.ranges},     {"record_bytes", work.record_bytes},
        {"sent_bytes", work.sent_bytes}, {"owned_bytes", work.owned}, {"peak_memory", work.peaks}};
  fmt::print("{}\n", json_text(document, 1));
}

void print_boundary(const BoundaryReport& boundary) {
  print_out("  {:>12} triangles of the boundary's {}, within {:.3g}, in {} bytes\n", boundary.kept, boundary.triangles,
            boundary.error, boundary.bytes);
  for (const auto& [name, triangles] : boundary.patches) print_out("  {:>12} of patch \"{}\"\n", triangles, name);
}

void print_cells(const CellReport& cells) {
  print_out("  {:>12} cells kept in {} bytes ({:.2f} each)\n", cells.cells, cells.bytes,
            static_cast<double>(cells.bytes) / static_cast<double>(std::max<std::uint64_t>(cells.cells, 1)));
  if (cells.collapsed > 0) print_out("  {:>12} cells left out: two of their corners are one point\n", cells.collapsed);
  if (cells.turned > 0) print_out("  {:>12} cells are turned inside out by rounding\n", cells.turned);
  if (cells.turned_volume > most_turned_volume * cells.volume)
    print_out("  warning: they are {:.2g} of the mesh's volume; --exact leaves none\n",
              cells.turned_volume / cells.volume);
}

void print_text(const Options& options, const InputNotes& notes, const BuildReport& report, double seconds) {
  const std::uint64_t points = report.resolution_counts.back();
  print_out("{}: {} points, {} resolutions ({}), connectivity {}, {} bytes ({:.1f} a point), {:.2f} s\n",
            options.output, points, report.resolution_counts.size(), fmt::join(report.resolution_counts, ", "),
            connectivity_name(report.connectivity), report.file_bytes,
            static_cast<double>(report.file_bytes) / static_cast<double>(points), seconds);
  if (notes.step)
    print_out("  {:>12} time (step {} of {})\n", notes.step->time, notes.step->index + 1, notes.step->times.size());
  if (notes.step && options.time && *options.time != notes.step->time)
    print_out("  time {} is the nearest to {}\n", notes.step->time, *options.time);
  if (!notes.times.empty())
    print_out("  {:>12} steps {}, times {} to {}\n", notes.times.size(), options.append ? "appended" : "written",
              notes.times.front(), notes.times.back());
  for (const std::string& conversion : notes.conversions) print_out("  {}\n", conversion);
  for (const auto& [name, same] : report.aliases)
    print_out("  {} is the same as {}: stored once, found by both names\n", name, same);
  for (const CensusLine& line : census_lines(report)) print_out("  {:>12} {}\n", line.count, line.words);
  for (const auto& lines : {warning_lines(report), notes.warnings})
    for (const std::string& warning : lines) print_out("  warning: {}\n", warning);
  if (notes.work.ranks > 1)
    print_out("  {:>12} processes, {} of which reduced points; {} bytes sent for {} bytes of records\n",
              notes.work.ranks, notes.work.ranges, notes.work.sent_bytes, notes.work.record_bytes);
  if (report.boundary) print_boundary(*report.boundary);
  if (report.kept_cells) print_cells(*report.kept_cells);
  if (notes.memory < report.least_memory)
    print_out("  {:>12} bytes were held, more than --memory grants: input and attributes need so many\n",
              report.least_memory);
}

Result<BuildOptions> build_options_of(const Options& options) {
  BuildOptions build_options;
  build_options.reduction = parse_reduction(options.reduction).value();
  build_options.leaf_points = options.leaf;
  build_options.gradients = options.gradients;
  build_options.strict = options.strict;
  build_options.keep_cells = !options.drop_cells;
  build_options.exact = {.positions = options.exact, .values = options.exact};
  if (options.boundary || options.boundary_triangles > 0)
    build_options.boundary_triangles =
        options.boundary_triangles > 0 ? options.boundary_triangles : usual_boundary_triangles;
  build_options.boundary_if_any = options.boundary_if_any;
  build_options.connectivity = parse_connectivity(options.connectivity).value();
  build_options.builder = "svbuild " SPLATVOL_VERSION;
  SPLATVOL_TRY_SET(build_options.memory, memory_or_quarter(options.memory));
  if (options.memory.empty()) build_options.memory /= processes_here();
  build_options.temp_folder = options.temp_folder;
  build_options.up = options.up.empty() ? usual_up(options.inputs) : options.up[0] - 'x';
  for (const std::string& unit : options.units) {
    const std::size_t equals = unit.rfind('=');
    build_options.units.emplace_back(unit.substr(0, equals), unit.substr(equals + 1));
  }
  for (const std::string& input : options.inputs)
    build_options.inputs.push_back(std::filesystem::path(input).filename());
  return build_options;
}

// The allocator keeps freed memory for later: some of what may be held. Above this limit it gives the memory back to
// the system.
void limit_allocator(std::uint64_t memory) {
  scalable_allocation_mode(TBBMALLOC_SET_SOFT_HEAP_LIMIT, static_cast<std::intptr_t>(memory / 8));
  scalable_allocation_mode(TBBMALLOC_USE_HUGE_PAGES, 1);  // where the system has them: a twentieth faster
}

bool is_series(const Options& options) {
  return options.series || options.series_of_files || options.append || !options.times.empty();
}

// The attributes of the series that steps are appended to; none without such a series.
Result<std::vector<std::string>> series_attributes(const Options& options) {
  if (!options.append) return std::vector<std::string>();
  SPLATVOL_TRY_ASSIGN(steps, format::Steps::open(options.output, open_file));
  return steps.times().empty() ? std::vector<std::string>() : steps.attributes();
}

// Whether readers may round coordinates. The points of an append must be those of its series.
Result<bool> may_round(const Options& options) {
  if (!options.append || options.series_of_files) return !options.exact;
  SPLATVOL_TRY_ASSIGN(steps, format::Steps::open(options.output, open_file));
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(0));
  return volume->info().position_error > 0;
}

SourceOptions source_options_of(const Options& options) {
  return {options.attributes,
          options.columns,
          options.time,
          cell_values_of(options.cells),
          options.missing,
          options.boundary || options.boundary_triangles > 0,
          false,
          !options.exact,
          !options.no_displacements};
}

InputReader input_reader(ReaderProcess& reader) {
  return {[&](const std::vector<std::string>& inputs, const SourceOptions& options) {
            return open_safely(reader, inputs, options);
          },
          [&](const std::vector<std::string>& inputs, const SourceOptions& options) {
            return list_safely(reader, inputs, options);
          }};
}

Result<std::vector<SeriesStep>> steps_of(const Options& options, const InputReader& reader) {
  SPLATVOL_TRY_ASSIGN(series, series_attributes(options));
  SourceOptions source_options = source_options_of(options);
  SPLATVOL_TRY_SET(source_options.may_round, may_round(options));
  if (options.times.empty()) return steps_of_files(options.inputs, source_options, reader, series);
  SPLATVOL_TRY_ASSIGN(range, parse_times(options.times));
  return steps_of_input(options.inputs, source_options, range, reader, series);
}

Result<BuildReport> build_steps(const Options& options, const BuildOptions& build_options, const InputReader& reader,
                                Stages& stages, InputNotes& notes) {
  SPLATVOL_TRY_ASSIGN(steps, steps_of(options, reader));
  stages.watch(steps);
  const BuildProgress progress = [&](const char* stage, double fraction) { stages.update(stage, fraction); };
  const auto report = options.series_of_files
                          ? build_series_of_files(steps, options.output, options.append, build_options, progress)
                      : options.append ? append_to_series(std::move(steps), options.output, build_options, progress)
                                       : build_series(std::move(steps), options.output, build_options, progress);
  if (!report) return tl::unexpected(report.error());
  notes.times = report->times;
  notes.conversions = report->conversions;
  notes.warnings = report->warnings;
  return report->build;
}

BuildKind kind_of(const Source& source, const BuildOptions& options) {
  const bool may_join =
      options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::delaunay;
  if (options.connectivity == Connectivity::mesh || (may_join && source.may_have_cells())) return BuildKind::mesh;
  return may_join && source.point_count().value_or(0) <= options.held_points ? BuildKind::joined : BuildKind::points;
}

Result<BuildReport> build_one(const Options& options, const BuildOptions& build_options, const OpenSource& open,
                              Stages& stages, InputNotes& notes) {
  std::unique_ptr<Source> source;
  const auto open_input = [&]() -> Result<std::unique_ptr<Source>> {
    SPLATVOL_TRY_ASSIGN(opened, open(options.inputs, source_options_of(options)));
    stages.set_kind(kind_of(*opened, build_options));
    return opened;
  };
  auto report = build_in_ranks(
      open_input, source, options.output, build_options,
      [&](const char* stage, double fraction) { stages.update(stage, fraction); }, notes.work);
  if (!source) return report;
  notes.step = source->time_step();
  notes.conversions = source->conversions();
  return report;
}

// What --estimate tells.
struct Estimate {
  InputSize input;
  BuildEstimate build = {};
  std::size_t steps = 1;
  unsigned threads = 1;
  std::uint64_t memory = 0;                // BuildOptions::memory
  std::uint64_t reader_bytes = 0;          // splatvol-read held at most; 0: it did not run
  std::string folder = {};                 // of the temporary files
  std::optional<std::uint64_t> room = {};  // free there; none if the folder is not known
};

// Returns the size of a step and the number of steps.
Result<std::pair<InputSize, std::size_t>> measure(const Options& options, const BuildOptions& build_options) {
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, options.threads));
  ReaderProcess reader(reader_options);
  const InputReader inputs = input_reader(reader);
  std::unique_ptr<Source> source;
  std::size_t steps = 1;
  if (is_series(options)) {
    SPLATVOL_TRY_ASSIGN(all, steps_of(options, inputs));
    SPLATVOL_TRY(store(all.back().open(), source));
    steps = all.size();
  } else {
    SPLATVOL_TRY(store(inputs.open(options.inputs, source_options_of(options)), source));
  }
  const bool use_cells =
      build_options.connectivity == Connectivity::automatic || build_options.connectivity == Connectivity::mesh;
  ProgressBar bar("reading");
  SPLATVOL_TRY_ASSIGN(size, measure_input(*source, use_cells, [&](double fraction) { bar.update(fraction); }));
  return std::pair(size, steps);
}

// The most memory of a process that has ended.
std::uint64_t memory_of_children() { return static_cast<std::uint64_t>(usage_of(RUSAGE_CHILDREN).ru_maxrss) * 1024; }

Result<Estimate> make_estimate(const Options& options) {
  SPLATVOL_TRY_ASSIGN(build_options, build_options_of(options));
  SPLATVOL_TRY_ASSIGN(measured, measure(options, build_options));
  Estimate estimate{.input = measured.first, .steps = measured.second, .memory = build_options.memory};
  estimate.threads = options.threads > 0 ? options.threads : static_cast<unsigned>(tbb::info::default_concurrency());
  const std::size_t in_a_file = options.series_of_files ? 1 : estimate.steps;
  estimate.build = estimate_build(estimate.input, build_options, in_a_file, estimate.threads);
  // At most: how many triangles a boundary has is not known.
  const double boundary = boundary_triangle_bytes * static_cast<double>(build_options.boundary_triangles);
  estimate.build.file.high += boundary;
  estimate.build.disk.high += boundary;
  const double files = options.series_of_files ? static_cast<double>(estimate.steps) : 1;
  BuildEstimate& build = estimate.build;
  for (double Range::*end : {&Range::low, &Range::high}) {
    build.disk.*end += (files - 1) * build.file.*end;
    build.file.*end *= files;
    build.seconds.*end *= files;
  }
  estimate.reader_bytes = memory_of_children();
  if (!options.temp_folder.empty() || !options.output.empty()) {
    estimate.folder = options.temp_folder.empty() ? folder_of(options.output) : options.temp_folder;
    SPLATVOL_TRY(store(free_disk_bytes(estimate.folder), estimate.room));
  }
  return estimate;
}

std::string range_text(const Range& range) {
  return fmt::format("{} to {}", byte_text(range.low), byte_text(range.high));
}

std::string seconds_text(double seconds) {
  if (seconds < 100) return fmt::format("{:.{}f} s", seconds, seconds < 10 ? 1 : 0);
  return seconds < 6000 ? fmt::format("{:.0f} min", seconds / 60) : fmt::format("{:.1f} h", seconds / 3600);
}

void print_estimate(const Options& options, const Estimate& estimate) {
  const InputSize& input = estimate.input;
  print_out("{}: {} points, {} attributes{}{}{}\n", options.inputs[0], input.points, input.attributes,
            input.tetrahedra > 0 ? fmt::format(", cells of {} tetrahedra", input.tetrahedra) : "",
            input.pieces > 1 ? fmt::format(", {} pieces", input.pieces) : "",
            estimate.steps > 1 ? fmt::format(", {} steps", estimate.steps) : "");
  print_out("  {}\n", input.was_read ? "counted by reading all of it: it does not declare how much it holds"
                                     : "as it declares; nothing else was read");
  const BuildEstimate& build = estimate.build;
  print_out("  {:>24} the file, with connectivity {}{}\n", range_text(build.file),
            connectivity_name(build.connectivity), build.keeps_cells ? ", cells kept" : "");
  print_out("  {:>24} of disk while it is built, the file included\n", range_text(build.disk));
  print_out("  {:>24} of memory, of which --memory grants {}\n", range_text(build.memory),
            byte_text(static_cast<double>(estimate.memory)));
  if (estimate.reader_bytes > 0)
    print_out("  {:>24} of memory more, to read the input: so much was held just now\n",
              byte_text(static_cast<double>(estimate.reader_bytes)));
  print_out("  {:>24} on {} threads\n",
            fmt::format("{} to {}", seconds_text(build.seconds.low), seconds_text(build.seconds.high)),
            estimate.threads);
  if (estimate.memory < build.least_memory)
    print_out("  {:>24} of memory are needed at least, more than --memory grants\n",
              byte_text(static_cast<double>(build.least_memory)));
  if (estimate.room && static_cast<double>(*estimate.room) < build.disk.high)
    print_out("  warning: {} are free in {}\n", byte_text(static_cast<double>(*estimate.room)), estimate.folder);
}

nlohmann::ordered_json json_of(const Range& range) { return {std::round(range.low), std::round(range.high)}; }

void print_estimate_json(const Estimate& estimate) {
  const InputSize& input = estimate.input;
  nlohmann::ordered_json document = {{"points", input.points},
                                     {"attributes", input.attributes},
                                     {"tetrahedra", input.tetrahedra},
                                     {"pieces", input.pieces},
                                     {"steps", estimate.steps},
                                     {"counted_by_reading", input.was_read},
                                     {"connectivity", connectivity_name(estimate.build.connectivity)},
                                     {"keeps_cells", estimate.build.keeps_cells},
                                     {"file_bytes", json_of(estimate.build.file)},
                                     {"disk_bytes", json_of(estimate.build.disk)},
                                     {"memory_bytes", json_of(estimate.build.memory)},
                                     {"memory_granted", estimate.memory},
                                     {"least_memory", estimate.build.least_memory},
                                     {"reader_bytes", estimate.reader_bytes},
                                     {"seconds", {estimate.build.seconds.low, estimate.build.seconds.high}},
                                     {"threads", estimate.threads}};
  if (estimate.room) document["free_bytes"] = *estimate.room;
  fmt::print("{}\n", json_text(document, 1));
}

Status print_estimate(const Options& options) {
  const auto estimate = make_estimate(options);
  if (!estimate) {
    const bool named = estimate.error().message.find(one_line(options.inputs[0])) != std::string::npos;
    return named ? Status(tl::unexpected(estimate.error())) : Status(fail_in(options.inputs[0], estimate.error()));
  }
  options.json ? print_estimate_json(*estimate) : print_estimate(options, *estimate);
  return {};
}

// The threads of a process that shares a machine with others of this build; 0: it has the machine, or a part of it that
// the launcher chose, to itself.
unsigned threads_of_process() {
  const auto cores = static_cast<unsigned>(tbb::info::default_concurrency()),
             here = static_cast<unsigned>(processes_here());
  const bool is_bound = static_cast<long>(cores) < ::sysconf(_SC_NPROCESSORS_ONLN);
  return here > 1 && !is_bound ? std::max(cores / here, 1u) : 0;
}

// A file that was built, and what there is to say about it.
struct BuiltFile {
  BuildReport report;
  InputNotes notes;
  ReadFiles read = {};
};

// `show_preview`: gets the path of the preview, if the options ask for one.
Result<BuiltFile> build_file(const Options& options, const ShowShare& show,
                             const std::function<void(const std::string&)>& show_preview = {}) {
  std::unique_ptr<tbb::global_control> limit;
  if (const unsigned threads = options.threads > 0 ? options.threads : threads_of_process())
    limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, threads);

  SPLATVOL_TRY(check_outputs({options.output}, options.inputs));
  if (is_series(options)) SPLATVOL_TRY(require_one_rank("a time series"));
  SPLATVOL_TRY_ASSIGN(build_options, build_options_of(options));
  limit_allocator(build_options.memory);
  Stages stages(show);
  InputNotes notes;
  notes.memory = build_options.memory;
  // No process knows the corners of the others' cells, and these are no points.
  if (build_options.keep_cells && cell_values_of(options.cells) == CellValues::own && !require_one_rank("it")) {
    build_options.keep_cells = false;
    notes.warnings.emplace_back("the file does not keep cells of their own: only one process alone can do so");
  }
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, options.threads));
  reader_options.progress = [&](double share) { stages.read(share); };
  ReaderProcess reader(reader_options);
  const std::string left_out = describe_left_out(options.inputs);
  if (options.strict && !left_out.empty()) return fail(ErrorCode::invalid_data, "{}", left_out);
  InputReader inputs = input_reader(reader);
  Preview preview(options.cache.preview, build_options, show_preview);
  if (!options.cache.preview.empty())
    inputs.open = [&preview, open = inputs.open](const std::vector<std::string>& paths, const SourceOptions& how) {
      return open(paths, how).map([&](std::unique_ptr<Source> source) { return preview.watch(std::move(source)); });
    };
  auto report = is_series(options) ? build_steps(options, build_options, inputs, stages, notes)
                                   : build_one(options, build_options, inputs.open, stages, notes);
  if (!report) {
    // Errors of the output name the output; errors of the data still need the input's name.
    const bool named = report.error().message.starts_with(one_line(options.output)) ||
                       report.error().message.find(one_line(options.inputs[0])) != std::string::npos;
    return named || is_series(options) ? tl::unexpected(report.error()) : fail_in(options.inputs[0], report.error());
  }
  if (!left_out.empty()) report->warnings.push_back(left_out);
  notes.stages = stages.times();
  return BuiltFile{std::move(*report), std::move(notes), reader.files()};
}

Status build(const Options& options) {
  const double start = seconds_now();
  SPLATVOL_TRY_ASSIGN(built, build_file(options, terminal_bar()));
  if (!built.notes.work.tells) return {};
  const double seconds = seconds_now() - start;
  options.json ? print_json(options, built.notes, built.report, seconds)
               : print_text(options, built.notes, built.report, seconds);
  return {};
}

// The options that the bytes of a file depend on.
std::string choices_of(const Options& options) {
  return json_text(nlohmann::ordered_json{{"attributes", options.attributes},
                                          {"reduction", options.reduction},
                                          {"leaf", options.leaf},
                                          {"connectivity", options.connectivity},
                                          {"columns", options.columns},
                                          {"time", options.time ? fmt::format("{}", *options.time) : ""},
                                          {"gradients", options.gradients},
                                          {"exact", options.exact},
                                          {"strict", options.strict},
                                          {"no_displacements", options.no_displacements},
                                          {"drop_cells", options.drop_cells},
                                          {"boundary_triangles", options.boundary_triangles},
                                          {"cells", options.cells},
                                          {"up", options.up},
                                          {"missing", fmt::format("{}", fmt::join(options.missing, " "))},
                                          {"times", options.times},
                                          {"series", options.series},
                                          {"series_of_files", options.series_of_files},
                                          {"units", options.units}});
}

// The file's name in the cache: that of the input.
std::string cached_name(const Options& options) {
  std::filesystem::path path(options.inputs[0]);
  if (path.filename() == "controlDict") path = path.parent_path().parent_path();
  if (!path.has_filename() || path.filename() == "." || path.filename() == "..") path = canonical_input(path);
  // Lines of JSON hold the name, and file systems take 255 bytes.
  const std::string name = one_line(path.stem().string().substr(0, 200));
  return (name.empty() ? "mesh" : name) + (options.series_of_files ? ".svols" : ".svol");
}

Status build_for_cache(const Options& given) {
  SPLATVOL_TRY(require_one_rank("--cached"));
  Options options = given;
  options.boundary = options.boundary_if_any = true;
  const auto build_it =
      [options](const std::string& output, const ShowShare& show,
                const std::function<void(const std::string&)>& show_preview) -> Result<CachedBuild::Outcome> {
    Options of_output = options;
    of_output.output = output;
    SPLATVOL_TRY_ASSIGN(built, build_file(of_output, show, show_preview));
    std::vector<std::string> notes = warning_lines(built.report);
    notes.insert(notes.end(), built.notes.warnings.begin(), built.notes.warnings.end());
    return CachedBuild::Outcome{std::move(notes), std::move(built.read)};
  };
  return build_cached(options.cache,
                      {options.inputs, choices_of(options), cached_name(options), options.json, build_it});
}

Status run(const Options& options) {
  if (options.cache.list) return list_cache(options.json);
  if (options.cache.forget) return forget_in_cache(options.inputs);
  if (options.cache.cached) return build_for_cache(options);
  SPLATVOL_TRY(check_no_address(options.inputs));
  return options.estimate ? print_estimate(options) : build(options);
}

// Ends the program if a command on the cache is called wrongly.
void check_cache_options(const Options& options) {
  const CacheOptions& cache = options.cache;
  if (static_cast<int>(cache.cached) + cache.list + cache.forget > 1)
    wrong_option("--cached", "goes with neither --cache nor --forget");
  if (!options.output.empty()) wrong_option("--output", "goes with no file of the cache");
  if (options.append) wrong_option("--append", "goes with no file of the cache");
  if (options.estimate) wrong_option("--estimate", "goes with no file of the cache");
}

void add_input_options(CommandLine& app, Options& options) {
  app.add_option("inputs", options.inputs,
                 "Meshes, voxels and points, or folders of them: " + input_formats_for_help() +
                     "; or points or a mesh to generate, as svgen does (gen:points:count=1e6)")
      ->type_name("IN...");
  app.add_option("-o,--output", options.output, "The file to write; needed but with --estimate and --cached")
      ->type_name("OUT.svol")
      ->check(check_not_empty);
  app.add_option("--attribute", options.attributes, "An attribute to keep; repeatable (default: all)")
      ->check(check_not_empty)
      ->type_name("NAME")
      ->allow_extra_args(false);
}

void add_reduction_options(CommandLine& app, Options& options) {
  app.add_option("--reduction", options.reduction,
                 "How coarser resolutions are chosen: octree (a point of each leaf, about a third), mis (an "
                 "independent set of the points' Delaunay triangulations, about a sixth; slow), kdtree (a point of "
                 "each bucket of a k-d tree, about a sixth: files are smaller by 8 to 18 %, but pictures of scattered "
                 "points are rougher for equally many splats)")
      ->one_of({"octree", "mis", "kdtree"})
      ->capture_default_str();
  app.add_option("--leaf", options.leaf, "Most points in a leaf of the reduction's octree or k-d tree, at least 8")
      ->range(1u, 65536u)
      ->check([](const std::string& text) {
        const bool enough = std::strtoul(text.c_str(), nullptr, 0) >= 8;
        return enough ? "" : "with fewer than 8, a split node could keep a point in each octant and lose none";
      })
      ->capture_default_str();
  app.add_option("--connectivity", options.connectivity,
                 "What joins points to a volume: auto (the input's cells; else delaunay, beyond 2^20 points none, "
                 "beyond 2^26 boxes), mesh (the cells), delaunay (tetrahedra, slow), none (the points' Voronoi cells), "
                 "boxes (a coarse estimate, fast)")
      ->one_of({"auto", "mesh", "delaunay", "none", "boxes"})
      ->capture_default_str();
}

void add_format_options(CommandLine& app, Options& options) {
  app.add_option("--columns", options.columns,
                 "Names of the columns of .npy and .csv files, commas between: x, y and z are the position, _ is left "
                 "out (default: the file's own, or x,y,z,value)")
      ->delimiter(',')
      ->type_name("NAME,...");
  add_cells_option(app, options.cells, "each cell is a point of its own, with one value in all of it");
  app.add_option("--time", options.time,
                 "For an input with time steps (Exodus, EnSight, OpenFOAM, CGNS, .pvd, .series, ...): take the step "
                 "nearest to this time (default: the last)")
      ->type_name("T")
      ->check(check_finite);
  add_displacements_option(app, options.no_displacements);
  app.add_flag("--gradients", options.gradients,
               "Keep the direction of each attribute's gradient at the points, about 3 bytes each: svrender --kernel "
               "octant needs it for scenes with lighting");
  app.add_flag("--exact", options.exact,
               "Store positions and values as they are given, values in single precision: without it, a position may "
               "move by 1/64 of the smallest deviation of the splats around, and a value by 1/16 of theirs. The file "
               "becomes larger, pictures stay the same");
  app.add_flag(
      "--strict", options.strict,
      "Write nothing if the file would not be the input as it is: arrays, cells or points left out, merged unlike or "
      "inverted, numbers taken as fill values, detail lost far from the origin or beside large values");
  app.add_option("--up", options.up,
                 "The axis that points upwards in pictures; kept in the file (default: for OpenFOAM that "
                 "of constant/g, else y with patches of the type empty, else z; for others none is "
                 "kept, and pictures take y)")
      ->one_of({"x", "y", "z"});
  app.add_option("--missing", options.missing,
                 "A number that stands for a value that is not there, such as -9999; repeatable (always: NaN, NetCDF's "
                 "default fill values, the largest number of single precision)")
      ->type_name("V")
      ->allow_extra_args(false);
}

void add_boundary_options(CommandLine& app, Options& options) {
  app.add_flag("--drop-cells", options.drop_cells,
               "Leave the cells of the mesh, or the Delaunay tetrahedra that join its points, out of the file: 2 to 3 "
               "bytes a tetrahedron less. Then there are no exact pictures and no svexport --cells, and in a series, "
               "blocks that touch share the values there. An append to OUT.svol does as its file does");
  app.add_flag(
      "--boundary", options.boundary,
      "Keep the boundary of the mesh in the file, for scenes that draw it: the faces of one cell only, by the "
      "patches of OpenFOAM, the side sets of Exodus, the boundary conditions of CGNS, the surface parts of "
      "EnSight, the physical groups of Gmsh and the markers of SU2. Of all other faces, those on a side of the mesh's "
      "box are the patches \"side x-\" to \"side z+\", and connected parts of the others \"outer 1\", \"outer 2\", "
      "...; \"outer\" is all of them");
  app.add_option(
         "--boundary-triangles", options.boundary_triangles,
         fmt::format("Most triangles of the boundary: if it has more, it is simplified, and the result says how "
                     "far the triangles are from it (default: {}). Implies --boundary",
                     usual_boundary_triangles))
      ->type_name("N")
      ->range(std::uint64_t{1000}, std::uint64_t{100000000});
}

void add_series_options(CommandLine& app, Options& options) {
  auto* times = app.add_option("--times", options.times,
                               "Build a time series: the steps of an input from time A to B, or all of them; mesh and "
                               "order are written once")
                    ->type_name("all|A:B")
                    ->excludes(app.get_option("--time"))
                    ->check(check_of(parse_times));
  app.add_flag("--series", options.series,
               "Build a time series: each input is a step, with the time that it states, or 0, 1, 2, ... Each step "
               "has the attributes of all; where it lacks one, the values are missing")
      ->excludes(app.get_option("--time"))
      ->excludes(times);
  app.add_flag("--series-of-files", options.series_of_files,
               "Build a file for each step and an index of them, OUT.svols: for meshes that change from step to step")
      ->excludes(app.get_option("--time"));
  app.add_flag("--append", options.append,
               "Append steps to the time series OUT.svol or OUT.svols, which stays as it was if this fails or is "
               "interrupted. If only the disk's confirmation fails, the steps are there, and a line says so. They get "
               "the attributes of the series; a step that has others needs --attribute. Several programs may append to "
               "one OUT.svols at once; OUT.svol takes one at a time")
      ->excludes(app.get_option("--time"));
}

void add_estimate_option(CommandLine& app, Options& options) {
  app.add_flag("--estimate", options.estimate,
               "Print how much memory, disk and time the build will need, each as a range, and write nothing. Inputs "
               "that do not declare how much they hold are read once, which takes a part of the time of a build");
}

void add_unit_option(CommandLine& app, Options& options) {
  app.add_option("--unit", options.units,
                 "The unit of an attribute, such as p=Pa, instead of the input's; repeatable. The unit of a vector is "
                 "that of its components")
      ->type_name("NAME=UNIT")
      ->allow_extra_args(false)
      ->check([](const std::string& text) {
        const std::size_t equals = text.rfind('=');
        const bool named = equals != std::string::npos && equals > 0;
        return named ? std::string() : "give NAME=UNIT, such as p=Pa: " + text;
      });
}

void add_machine_options(CommandLine& app, Options& options) {
  app.add_option("--memory", options.memory,
                 "Bytes to hold besides a piece of the input as its reader holds it, such as 2G (default: a quarter of "
                 "the machine's or container's); the result is the same. If the input needs more, svbuild says so")
      ->type_name("SIZE")
      ->check(check_of(parse_bytes));
  app.add_option("--temp", options.temp_folder, "Folder for temporary files (default: the folder of the output)")
      ->type_name("DIR")
      ->existing_folder();
  app.add_option("--threads", options.threads, "Threads to use (default: all cores)")->range(1u, 4096u);
  add_reading_options(app, options.reading);
  app.add_flag("--json", options.json, "Print the result as JSON");
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  if (const int code = join_ranks(argc, argv); code >= 0) return code;
  Options options;
  CommandLine app("Turns meshes and point sets into one coarse-first .svol file", "svbuild");
  add_input_options(app, options);
  add_reduction_options(app, options);
  add_format_options(app, options);
  add_boundary_options(app, options);
  add_series_options(app, options);
  add_estimate_option(app, options);
  add_unit_option(app, options);
  add_machine_options(app, options);
  add_cache_options(app, options.cache);
  app.callback([&options] {
    const CacheOptions& cache = options.cache;
    if (options.inputs.empty() && !cache.list && !cache.forget) missing_option("inputs");
    if (!cache.cached && cache.progress) wrong_option("--progress", "goes with --cached");
    if (!cache.cached && !cache.preview.empty()) wrong_option("--preview", "goes with --cached");
    if (cache.cached || cache.list || cache.forget) return check_cache_options(options);
    if (options.output.empty() && options.estimate) return;
    if (options.output.empty()) missing_option("--output");
    // build_series_of_files() checks the name of an index.
    const std::string wrong = options.series_of_files ? "" : check_svol_path(options.output);
    if (!wrong.empty()) wrong_option("--output", wrong);
  });
  const int code = run_tool(app, argc, argv, [&] { return run(options); });
  leave_ranks();
  return code;
}
