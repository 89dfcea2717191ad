#include "builder/pipeline/reduce_source.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "builder/output/row_collector.h"
#include "builder/pipeline/census_lines.h"
#include "builder/pipeline/connect.h"
#include "builder/pipeline/describe.h"
#include "builder/pipeline/memory_plan.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/material_estimator.h"
#include "builder/reduction/reduction_pipeline.h"
#include "format/volume_info.h"

namespace splatvol {
namespace {

// Reduces points that are joined. Called once.
class Reducer {
 public:
  // `points`: those of the connection; forgotten once all have been reduced.
  Reducer(const BuildOptions& options, std::optional<PointStream>& points, Connection connection, std::string folder,
          const BuildProgress& progress, MeshCells* cells)
      : options_(options),
        points_(points),
        input_(points->summary()),
        connection_(std::move(connection)),
        folder_(std::move(folder)),
        progress_(progress),
        cells_(cells),
        info_(describe_volume(options, input().cube, input().attributes)),
        plan_(plan_memory(memory(), shape())) {}

  Result<BuildReport> run(RowFiles& files, const WriteReduced& write) {
    const RowPacker packer(info_, options_.exact);
    RowCollector rows(info_, options_.points_per_chunk, plan_.rows, folder_);
    IndexLeafSpool leaves(folder_);
    const ReductionSettings settings = reduction_settings(packer);
    ReductionPass pass(
        settings, rows, [&](const OpenIndexLeaf& leaf) { return leaves.append(leaf); }, plan_.most_open_leaves);
    SPLATVOL_TRY(reduce(pass, rows, packer, files));
    connection_.next = {};  // and what it holds
    input_.census = points_->summary().census;
    points_.reset();
    SPLATVOL_TRY_ASSIGN(rest, rows.extract_rest());
    SPLATVOL_TRY(write_rows(rest, packer, files));
    progress_("indexing", 0);
    const StoredSummary stored = packer.summary();
    BuildReport report =
        complete_description(options_, input(),
                             {.connectivity = connection_.used,
                              .uncertain = connection_.subdomains ? connection_.subdomains->uncertain() : 0,
                              .disputed = connection_.subdomains ? connection_.subdomains->disputed() : 0,
                              .least_memory = std::max(least_memory(), input().bytes_to_read),
                              .counts = pass.counts(),
                              .stored = stored},
                             info_);
    if (options_.strict) SPLATVOL_TRY(check_unchanged(report));
    SPLATVOL_TRY(write({std::move(info_), report, files, leaves, pass, stored.histograms(), cells_}));
    return report;
  }

 private:
  [[nodiscard]] const InputSummary& input() const { return input_; }

  [[nodiscard]] std::uint64_t least_memory() const {
    return connection_.memory > 0 ? plan_.least + connection_.least_memory
                                  : std::max(plan_.least, connection_.least_memory);
  }

  // Bytes for the reduction.
  [[nodiscard]] std::uint64_t memory() const { return options_.memory - std::min(options_.memory, connection_.memory); }

  [[nodiscard]] BuildShape shape() const {
    return {.attributes = input().attributes.size(),
            .gradients = options_.gradients,
            .estimates = connection_.needs_estimate,
            .index_leaf_points = index_leaf_points(options_)};
  }

  ReductionSettings reduction_settings(const RowPacker& packer) const {
    WatchStays stays;
    if (cells_)
      stays = [cells = cells_](std::size_t level, std::uint64_t rank) { return cells->add_stay(level, rank); };
    return {.cube = input().cube,
            .leaf_points = options_.leaf_points,
            .reduces = connection_.points > coarsest_target,
            .attributes = input().attributes,
            .packer = &packer,
            .points_per_chunk = options_.points_per_chunk.of(0),
            .method = options_.reduction,
            .stays = std::move(stays)};
  }

  Status reduce(ReductionPass& pass, RowCollector& rows, const RowPacker& packer, RowFiles& files) const {
    const std::size_t attributes = input().attributes.size();
    BatchCutter batches(connection_.next, attributes, index_leaf_points(options_), plan_.batches);
    MaterialEstimator estimator(input().box, input().cube, options_.gradients);
    const ReductionStages stages{batches, connection_.needs_estimate ? &estimator : nullptr, pass, rows, packer, files};
    const auto progress = [&](std::uint64_t done) {
      progress_("reducing", static_cast<double>(done) / static_cast<double>(points_->count()));
    };
    return run_reduction(stages, attributes, progress, plan_.most_batches);
  }

  const BuildOptions& options_;
  std::optional<PointStream>& points_;
  InputSummary input_;
  Connection connection_;
  std::string folder_;
  const BuildProgress& progress_;
  MeshCells* cells_;  // null: no one asks what stays
  format::VolumeInfo info_;
  MemoryPlan plan_;
};

}  // namespace

Status check_reduction(const BuildOptions& options) {
  if (options.leaf_points < 8)
    return fail(ErrorCode::invalid_argument,
                "a leaf must be allowed 8 points or more: with {}, a node could be split without losing any",
                options.leaf_points);
  const std::vector<std::uint32_t>& chunks = options.points_per_chunk.points;
  if (chunks.empty() || std::ranges::min(chunks) < format::min_points_per_chunk ||
      std::ranges::max(chunks) > format::max_points_per_chunk)
    return fail(ErrorCode::invalid_argument, "a chunk must be allowed {} to {} points", format::min_points_per_chunk,
                format::max_points_per_chunk);
  return {};
}

bool uses_cells(const BuildOptions& options) {
  return options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::mesh;
}

std::uint64_t index_leaf_points(const BuildOptions& options) {
  return std::max<std::uint64_t>({options.index_leaf_points, options.leaf_points, 255});
}

JoinedAttributes joined_attributes(const BuildOptions& options) {
  JoinedAttributes joined{.join = options.join_attributes};
  for (const auto& [name, unit] : options.units) joined.apart.push_back(name);
  return joined;
}

Result<BuildReport> reduce_source(Source& source, const BuildOptions& options, RowFiles& files,
                                  const std::string& folder, const BuildProgress& progress, const WriteReduced& write,
                                  WatchPoints watch, MeshCells* cells) {
  SPLATVOL_TRY(check_reduction(options));
  const auto read = [&](double fraction) { progress("reading", fraction); };
  SPLATVOL_TRY_ASSIGN(points, PointStream::create(source, uses_cells(options), options.memory / 2, folder, read,
                                                  options.gradients, joined_attributes(options), std::move(watch)));
  return reduce_points(std::move(points), options, files, folder, progress, write, cells);
}

Result<BuildReport> reduce_points(PointStream stream, const BuildOptions& options, RowFiles& files,
                                  const std::string& folder, const BuildProgress& progress, const WriteReduced& write,
                                  MeshCells* cells) {
  const auto joined = [&](double fraction) { progress("connecting", fraction); };
  joined(0);
  std::optional<PointStream> points(std::move(stream));
  SPLATVOL_TRY_ASSIGN(connection, connect(options, *points, folder, cells, joined));
  if (connection.used == Connectivity::none || connection.used == Connectivity::boxes) cells = nullptr;
  return Reducer(options, points, std::move(connection), folder, progress, cells).run(files, write);
}

BuildReport complete_description(const BuildOptions& options, const InputSummary& input, const ReductionFacts& facts,
                                 format::VolumeInfo& info) {
  info.position_error = facts.stored.position_error + input.cells.rounded_by;
  info.aliases = input.aliases;
  info.resolution_counts.assign(facts.counts.rbegin(), facts.counts.rend());
  info.points_per_chunk = options.points_per_chunk.coarsest_first(facts.counts.size());
  BuildReport report{.resolution_counts = info.resolution_counts,
                     .connectivity = facts.connectivity,
                     .points = input.census,
                     .cells = input.cells,
                     .uncertain = facts.uncertain,
                     .disputed = facts.disputed,
                     .least_memory = facts.least_memory,
                     .warnings = precision_warnings(input),
                     .lost = lost_values(input, options.exact.values)};
  for (std::size_t a = 0; a < info.attributes.size(); ++a) {
    info.attributes[a].missing = facts.stored.values[a].missing;
    info.attributes[a].error = facts.stored.values[a].error * info.attributes[a].scale;
    report.missing.emplace_back(info.attributes[a].name, facts.stored.values[a].missing);
    report.fills.emplace_back(info.attributes[a].name, input.fills[a]);
  }
  for (const format::Alias& alias : info.aliases)
    report.aliases.emplace_back(alias.name, info.attributes[static_cast<std::size_t>(alias.attribute)].name);
  info.provenance = describe_provenance(options, report);
  return report;
}

Result<format::PackedIndex> pack_index(ReducedSource& reduced, const std::string& folder,
                                       const format::IndexPacker::EmitSummaries& emit_summaries) {
  const std::size_t resolutions = reduced.info.resolutions(), attributes = reduced.info.attributes.size();
  SPLATVOL_TRY_ASSIGN(pages, TempFile::create(folder));
  const auto emit = [&](const format::PackedIndexPage& page) { return pages.append(page.bytes); };
  IndexStream index = emit_summaries ? IndexStream(reduced.info.cube, resolutions, attributes, emit, emit_summaries)
                                     : IndexStream(reduced.info.cube, resolutions, attributes, emit);
  const auto add = [&](IndexLeaf leaf) -> Status {
    const std::uint64_t points = std::accumulate(leaf.counts.begin(), leaf.counts.end(), std::uint64_t{0});
    if (reduced.cells) SPLATVOL_TRY(reduced.cells->add_leaf(points));
    return index.add(std::move(leaf));
  };
  SPLATVOL_TRY(reduced.leaves.read(resolutions, reduced.pass.late_leaves(), add));
  SPLATVOL_TRY_ASSIGN(root, index.finish());
  const format::NodeShape shape = IndexStream::shape(resolutions, emit_summaries ? 0 : attributes);
  return format::PackedIndex{shape, std::move(root), std::move(pages)};
}

}  // namespace splatvol
