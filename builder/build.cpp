#include "builder/build.h"

#include <algorithm>
#include <functional>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "base/temp_file.h"
#include "builder/connect.h"
#include "builder/describe.h"
#include "builder/output/index_leaf_spool.h"
#include "builder/output/index_stream.h"
#include "builder/output/row_collector.h"
#include "builder/output/row_files.h"
#include "builder/output/row_packer.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/material_estimator.h"
#include "builder/reduction/reduction_pass.h"
#include "builder/reduction/reduction_pipeline.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

// Most points whose densities are fitted.
constexpr std::uint64_t most_fitted_points = std::uint64_t{1} << 19;

// Writes the volume of points that are joined. Called once.
class VolumeBuild {
 public:
  VolumeBuild(const BuildOptions& options, const PointStream& points, Connection connection, std::string folder,
              const BuildProgress& progress)
      : options_(options),
        points_(points),
        connection_(std::move(connection)),
        folder_(std::move(folder)),
        progress_(progress),
        info_(describe_volume(options, input().cube, input().attributes)),
        fits_(connection_.points <= most_fitted_points) {
    for (const format::Attribute& attribute : input().attributes) offsets_.push_back(attribute.offset);
  }

  Result<BuildReport> run(AtomicFile file) {
    const RowPacker packer(info_);
    RowFiles files(folder_, file);
    RowCollector rows(info_, fits_);
    SPLATVOL_TRY_ASSIGN(leaf_file, TempFile::create(folder_));
    IndexLeafSpool leaves(std::move(leaf_file));
    const ReductionSettings settings = reduction_settings(packer);
    ReductionPass pass(settings, rows, [&](const OpenIndexLeaf& leaf) { return leaves.append(leaf); });
    SPLATVOL_TRY(reduce(pass, rows, packer, files));
    progress_("fitting densities", 0);
    std::vector<PendingRow> rest = rows.extract_rest();
    SPLATVOL_TRY(write_rows(rest, packer, files));
    progress_("indexing", 0);
    SPLATVOL_TRY_ASSIGN(index, pack_index(leaves, pass));
    BuildReport report = finish_description(pass);
    SPLATVOL_TRY_ASSIGN(written, write(std::move(file), files, std::move(index), pass.histograms()));
    report.file_bytes = written;
    return report;
  }

 private:
  [[nodiscard]] const InputSummary& input() const { return points_.summary(); }

  ReductionSettings reduction_settings(const RowPacker& packer) const {
    return {.cube = input().cube,
            .leaf_points = options_.leaf_points,
            .reduces = connection_.points > coarsest_target,
            .wants_splats = fits_,
            .attributes = input().attributes,
            .offsets = offsets_,
            .packer = fits_ ? nullptr : &packer,
            .points_per_chunk = options_.points_per_chunk,
            .method = options_.reduction};
  }

  Status reduce(ReductionPass& pass, RowCollector& rows, const RowPacker& packer, RowFiles& files) const {
    const std::size_t attributes = input().attributes.size();
    const std::uint64_t leaf_points = std::max<std::uint64_t>({options_.index_leaf_points, options_.leaf_points, 255});
    BatchCutter batches(connection_.next, attributes, leaf_points);
    MaterialEstimator estimator(input().box, input().cube);
    const ReductionStages stages{batches, connection_.needs_estimate ? &estimator : nullptr, pass, rows, packer, files};
    return run_reduction(stages, attributes, [&](std::uint64_t done) {
      progress_("reducing", static_cast<double>(done) / static_cast<double>(points_.count()));
    });
  }

  Result<format::PackedIndex> pack_index(IndexLeafSpool& leaves, const ReductionPass& pass) const {
    const std::size_t resolutions = pass.counts().size(), attributes = input().attributes.size();
    SPLATVOL_TRY_ASSIGN(pages, TempFile::create(folder_));
    IndexStream index(input().cube, resolutions, attributes,
                      [&](const format::PackedIndexPage& page) { return pages.append(page.bytes); });
    SPLATVOL_TRY(
        leaves.read(resolutions, pass.late_leaves(), [&](IndexLeaf leaf) { return index.add(std::move(leaf)); }));
    SPLATVOL_TRY_ASSIGN(root, index.finish());
    return format::PackedIndex{IndexStream::shape(resolutions, attributes), std::move(root), std::move(pages)};
  }

  // Completes the volume's description, and returns the report, without the file's size.
  BuildReport finish_description(const ReductionPass& pass) {
    const std::vector<std::uint64_t> counts = pass.counts();
    info_.resolution_counts.assign(counts.rbegin(), counts.rend());
    BuildReport report{.resolution_counts = info_.resolution_counts,
                       .connectivity = connection_.used,
                       .points = input().census,
                       .cells = input().cells,
                       .uncertain = connection_.subdomains ? connection_.subdomains->uncertain() : 0};
    for (std::size_t a = 0; a < info_.attributes.size(); ++a) {
      info_.attributes[a].missing = pass.missing()[a];
      report.missing.emplace_back(info_.attributes[a].name, pass.missing()[a]);
    }
    info_.provenance = describe_provenance(options_, report);
    return report;
  }

  // Returns the file's size in bytes.
  Result<std::uint64_t> write(AtomicFile file, RowFiles& files, format::PackedIndex index,
                              const format::Histograms& histograms) const {
    SPLATVOL_TRY_ASSIGN(
        writer, format::VolumeWriter::create(std::move(file), files.coarse_bytes(), info_, std::move(index), folder_));
    std::uint64_t row = 0;
    SPLATVOL_TRY(
        files.read(info_.resolutions(),
                   [&](std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) -> Status {
                     progress_("writing", static_cast<double>(++row) / static_cast<double>(writer->rows().row_count()));
                     return bytes.empty() ? writer->add_written_row(entries) : writer->append_row(entries, bytes);
                   }));
    SPLATVOL_TRY(writer->finish(histograms));
    return writer->file_bytes();
  }

  const BuildOptions& options_;
  const PointStream& points_;
  Connection connection_;
  std::string folder_;
  const BuildProgress& progress_;
  format::VolumeInfo info_;
  bool fits_;                    // densities
  std::vector<double> offsets_;  // [attribute]
};

}  // namespace

const char* connectivity_name(Connectivity connectivity) {
  switch (connectivity) {
    case Connectivity::mesh:
      return "mesh";
    case Connectivity::delaunay:
      return "delaunay";
    case Connectivity::none:
      return "none";
    default:
      return "auto";
  }
}

Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                 const BuildProgress& progress) {
  if (options.leaf_points < 8)
    return fail(ErrorCode::invalid_argument,
                "a leaf must be allowed 8 points or more: with {}, a node could be split without losing any",
                options.leaf_points);
  for (const auto& [name, unit] : options.units)
    if (std::ranges::find(source.attributes(), name) == source.attributes().end())
      return fail_no_attribute("unit " + unit, name, source.attributes());
  // If the file cannot be written, this fails before the work.
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(output));
  // A folder with room for the file has room for parts of it.
  const std::string folder = options.temp_folder.empty() ? folder_of(output) : options.temp_folder;
  const bool use_cells = options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::mesh;
  SPLATVOL_TRY_ASSIGN(points, PointStream::create(source, use_cells, options.memory / 2, folder,
                                                  [&](double fraction) { progress("reading", fraction); }));
  progress("connecting", 0);
  SPLATVOL_TRY_ASSIGN(connection, connect(options, points, folder));
  return VolumeBuild(options, points, std::move(connection), folder, progress).run(std::move(file));
}

}  // namespace splatvol
