// From a source to packed rows and index leaves: the part of a build that comes before the file.
#pragma once

#include <functional>
#include <string>

#include "base/error.h"
#include "builder/cells/mesh_cells.h"
#include "builder/output/index_leaf_spool.h"
#include "builder/output/index_stream.h"
#include "builder/output/row_files.h"
#include "builder/pipeline/build.h"
#include "builder/points/point_stream.h"
#include "builder/reduction/reduction_pass.h"
#include "builder/sources/source.h"
#include "format/volume_info.h"

namespace splatvol {

struct ReducedSource {
  format::VolumeInfo info;  // whole
  const BuildReport& report;
  RowFiles& files;
  IndexLeafSpool& leaves;
  const ReductionPass& pass;
  format::Histograms histograms;
  MeshCells* cells = nullptr;  // that may be kept; null: there are none
};

using WriteReduced = std::function<Status(ReducedSource)>;

/// Reads the whole source, reduces it, and calls `write` with the result. `files` gets the rows; `folder`: for
/// temporary files. `watch`: as for PointStream; `cells`: as for reduce_points. Returns the report without the file's
/// size. Fails as build_volume, and if `write` or `watch` fails.
[[nodiscard]] Result<BuildReport> reduce_source(Source& source, const BuildOptions& options, RowFiles& files,
                                                const std::string& folder, const BuildProgress& progress,
                                                const WriteReduced& write, WatchPoints watch,
                                                MeshCells* cells = nullptr);

/// Fails if the options are out of their ranges.
[[nodiscard]] Status check_reduction(const BuildOptions& options);

/// Whether cells of the input are used.
[[nodiscard]] bool uses_cells(const BuildOptions& options);

/// Most points in an index leaf.
[[nodiscard]] std::uint64_t index_leaf_points(const BuildOptions& options);

[[nodiscard]] JoinedAttributes joined_attributes(const BuildOptions& options);

/// The same as reduce_source for points that are sorted. `cells`: learns what stays for coarser resolutions, and gets
/// tetrahedra that join scattered points; may be null. `write` gets them unless what joins the points has none.
[[nodiscard]] Result<BuildReport> reduce_points(PointStream points, const BuildOptions& options, RowFiles& files,
                                                const std::string& folder, const BuildProgress& progress,
                                                const WriteReduced& write, MeshCells* cells = nullptr);

struct ReductionFacts {
  Connectivity connectivity = Connectivity::mesh;
  std::uint64_t uncertain = 0;  // DelaunaySubdomains::uncertain()
  std::uint64_t disputed = 0;   // DelaunaySubdomains::disputed()
  std::uint64_t least_memory = 0;
  std::vector<std::uint64_t> counts = {};  // points of each level, from the finest on
  StoredSummary stored = {};
};

/// Completes the description of a volume whose rows are packed. Returns the report without the file's size.
[[nodiscard]] BuildReport complete_description(const BuildOptions& options, const InputSummary& input,
                                               const ReductionFacts& facts, format::VolumeInfo& info);

/// Packs the index, and tells the cells the sizes of its leaves. With `emit_summaries`: that of a time series
/// (format::IndexPacker). Called once.
[[nodiscard]] Result<format::PackedIndex> pack_index(ReducedSource& reduced, const std::string& folder,
                                                     const format::IndexPacker::EmitSummaries& emit_summaries = {});

}  // namespace splatvol
