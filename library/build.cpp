#include "splatvol/build.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "base/memory_limit.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/census_lines.h"
#include "builder/series/series_build.h"
#include "builder/sources/arrays_source.h"
#include "splatvol/version.h"

namespace splatvol {
namespace {

Result<BuildOptions> build_options_of(const MeshBuildOptions& options) {
  BuildOptions result;
  SPLATVOL_TRY_SET(result.connectivity, parse_connectivity(options.connectivity));
  SPLATVOL_TRY_SET(result.reduction, parse_reduction(options.reduction));
  if (options.up != 0 && (options.up < 'x' || options.up > 'z'))
    return fail(ErrorCode::invalid_argument, "up '{}': take x, y or z", options.up);
  if (options.up != 0) result.up = options.up - 'x';
  result.memory = options.memory > 0 ? options.memory : memory_limit() / 4;
  result.temp_folder = options.temp_folder;
  result.exact = {.positions = options.exact, .values = options.exact};
  result.strict = options.strict;
  result.boundary_triangles = options.boundary_triangles;
  result.keep_cells = options.keep_cells;
  result.inputs = {options.name};
  result.builder = "splatvol " SPLATVOL_VERSION;
  return result;
}

MeshBuildReport report_of(const BuildReport& built, std::vector<std::string> conversions) {
  MeshBuildReport report{.resolution_counts = built.resolution_counts,
                         .file_bytes = built.file_bytes,
                         .connectivity = connectivity_name(built.connectivity),
                         .census = {},
                         .warnings = warning_lines(built),
                         .conversions = std::move(conversions),
                         .kept_cells = built.kept_cells ? built.kept_cells->cells : 0};
  for (const CensusLine& line : census_lines(built)) report.census.emplace_back(line.words, line.count);
  return report;
}

SourceOptions source_options_of(const MeshBuildOptions& options) {
  SourceOptions result{.cells = options.own_cells ? CellValues::own : CellValues::averaged, .missing = options.missing};
  return result;
}

Status check_output(const std::string& output) {
  if (std::filesystem::path(output).extension() == ".svol") return {};
  return fail(ErrorCode::invalid_argument, "{}: the name of the output must end in .svol", output);
}

BuildProgress progress_of(const MeshBuildOptions& options) {
  return [&options](const char* stage, double share) {
    if (options.progress) options.progress(stage, share);
  };
}

// Names what an error is about, unless its message does.
tl::unexpected<Error> named(const Error& error, const std::string& output, const MeshBuildOptions& options) {
  const bool is_named = error.message.starts_with(output) || error.message.starts_with(options.name);
  return is_named ? tl::unexpected(error) : fail_in(options.name, error);
}

// Returns a mesh with the values of a step, for each step.
Result<std::vector<MeshArrays>> meshes_of(const MeshArrays& mesh, std::span<const MeshStep> steps,
                                          const std::string& name) {
  if (!mesh.point_values.empty() || !mesh.cell_values.empty())
    return fail(ErrorCode::invalid_argument, "{}: the values of a time series belong to its steps", name);
  std::vector<MeshArrays> meshes;
  double last = -std::numeric_limits<double>::infinity();
  for (const MeshStep& step : steps) {
    if (!std::isfinite(step.time) || step.time <= last)
      return fail(ErrorCode::invalid_argument, "{}: times of steps rise; {} does not, after {}", name, step.time, last);
    last = step.time;
    MeshArrays& arrays = meshes.emplace_back(mesh);
    arrays.point_values = step.point_values;
    arrays.cell_values = step.cell_values;
  }
  return meshes;
}

using SeriesCall = Result<SeriesReport> (*)(std::vector<SeriesStep>, const std::string&, const BuildOptions&,
                                            const BuildProgress&);

Result<MeshBuildReport> write_series(const MeshArrays& mesh, std::span<const MeshStep> steps, const std::string& output,
                                     const MeshBuildOptions& options, SeriesCall write) {
  SPLATVOL_TRY_ASSIGN(build_options, build_options_of(options));
  SPLATVOL_TRY(check_output(output));
  SPLATVOL_TRY_ASSIGN(meshes, meshes_of(mesh, steps, options.name));
  std::vector<SeriesStep> opened;
  for (std::size_t s = 0; s < steps.size(); ++s) {
    const std::string name = fmt::format("{} at {}", options.name, steps[s].time);
    opened.push_back(
        {name, steps[s].time, [&, s, name] { return open_arrays(name, meshes[s], source_options_of(options)); }});
  }
  const auto built = write(std::move(opened), output, build_options, progress_of(options));
  if (!built) return named(built.error(), output, options);
  MeshBuildReport report = report_of(built->build, built->conversions);
  report.warnings.insert(report.warnings.end(), built->warnings.begin(), built->warnings.end());
  return report;
}

}  // namespace

Result<MeshBuildReport> build(const MeshArrays& mesh, const std::string& output, const MeshBuildOptions& options) {
  SPLATVOL_TRY_ASSIGN(build_options, build_options_of(options));
  SPLATVOL_TRY(check_output(output));
  SPLATVOL_TRY_ASSIGN(source, open_arrays(options.name, mesh, source_options_of(options)));
  const auto built = build_volume(*source, output, build_options, progress_of(options));
  if (!built) return named(built.error(), output, options);
  return report_of(*built, source->conversions());
}

Result<MeshBuildReport> build_series(const MeshArrays& mesh, std::span<const MeshStep> steps, const std::string& output,
                                     const MeshBuildOptions& options) {
  return write_series(mesh, steps, output, options,
                      [](auto opened, const auto& path, const auto& built_by, const auto& progress) {
                        return build_series(std::move(opened), path, built_by, progress);
                      });
}

Result<MeshBuildReport> append_to_series(const MeshArrays& mesh, std::span<const MeshStep> steps,
                                         const std::string& path, const MeshBuildOptions& options) {
  return write_series(mesh, steps, path, options,
                      [](auto opened, const auto& output, const auto& built_by, const auto& progress) {
                        return append_to_series(std::move(opened), output, built_by, progress);
                      });
}

}  // namespace splatvol
