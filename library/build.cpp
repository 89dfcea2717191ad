#include "splatvol/build.h"

#include <filesystem>
#include <utility>

#include "base/memory_limit.h"
#include "builder/build.h"
#include "builder/census_lines.h"
#include "builder/sources/arrays_source.h"
#include "splatvol/version.h"

namespace splatvol {
namespace {

Result<Connectivity> parse_connectivity(const std::string& name) {
  for (const Connectivity connectivity :
       {Connectivity::automatic, Connectivity::mesh, Connectivity::delaunay, Connectivity::none, Connectivity::boxes})
    if (name == connectivity_name(connectivity)) return connectivity;
  return fail(ErrorCode::invalid_argument, "connectivity \"{}\": take auto, mesh, delaunay, none or boxes", name);
}

Result<Reduction> parse_reduction(const std::string& name) {
  for (const Reduction reduction : {Reduction::octree, Reduction::mis, Reduction::kdtree})
    if (name == reduction_name(reduction)) return reduction;
  return fail(ErrorCode::invalid_argument, "reduction \"{}\": take octree, mis or kdtree", name);
}

Result<BuildOptions> build_options_of(const MeshBuildOptions& options) {
  BuildOptions result;
  SPLATVOL_TRY_ASSIGN(connectivity, parse_connectivity(options.connectivity));
  result.connectivity = connectivity;
  SPLATVOL_TRY_ASSIGN(reduction, parse_reduction(options.reduction));
  result.reduction = reduction;
  if (options.up != 0 && (options.up < 'x' || options.up > 'z'))
    return fail(ErrorCode::invalid_argument, "up '{}': take x, y or z", options.up);
  if (options.up != 0) result.up = options.up - 'x';
  result.memory = options.memory > 0 ? options.memory : memory_limit() / 4;
  result.temp_folder = options.temp_folder;
  result.exact = {.positions = options.exact, .values = options.exact};
  result.strict = options.strict;
  result.inputs = {options.name};
  result.builder = "splatvol " SPLATVOL_VERSION;
  return result;
}

MeshBuildReport report_of(const BuildReport& built, std::vector<std::string> conversions) {
  MeshBuildReport report{.resolution_counts = built.resolution_counts,
                         .file_bytes = built.file_bytes,
                         .connectivity = connectivity_name(built.connectivity),
                         .census = {},
                         .warnings = built.warnings,
                         .conversions = std::move(conversions)};
  for (const CensusLine& line : census_lines(built)) report.census.emplace_back(line.words, line.count);
  return report;
}

}  // namespace

Result<MeshBuildReport> build(const MeshArrays& mesh, const std::string& output, const MeshBuildOptions& options) {
  SPLATVOL_TRY_ASSIGN(build_options, build_options_of(options));
  if (std::filesystem::path(output).extension() != ".svol")
    return fail(ErrorCode::invalid_argument, "{}: the name of the output must end in .svol", output);
  SourceOptions source_options;
  source_options.cells = options.own_cells ? CellValues::own : CellValues::averaged;
  source_options.missing = options.missing;
  SPLATVOL_TRY_ASSIGN(source, open_arrays(options.name, mesh, source_options));
  const BuildProgress progress = [&](const char* stage, double share) {
    if (options.progress) options.progress(stage, share);
  };
  auto built = build_volume(*source, output, build_options, progress);
  if (!built) {
    const bool is_named = built.error().message.starts_with(output) || built.error().message.starts_with(options.name);
    return is_named ? tl::unexpected(built.error()) : fail_in(options.name, built.error());
  }
  return report_of(*built, source->conversions());
}

}  // namespace splatvol
