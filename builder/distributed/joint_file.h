// The file that several ranks make together, once all rows are packed.
#pragma once

#include <string>

#include "builder/distributed/joint_cells.h"
#include "builder/distributed/range_reduction.h"
#include "builder/distributed/ranks.h"
#include "builder/distributed/shared_output.h"
#include "builder/pipeline/build.h"

namespace splatvol {

/// Collective: writes the file. Rank 0 packs the index. Then every rank writes its rows where they belong, and rank 0
/// the directory and all else, the `cells` last (null: the file keeps none). `info` and `histograms`: whole, on rank 0.
/// Returns the file's bytes, on rank 0.
[[nodiscard]] Result<std::uint64_t> write_joint_file(Ranks& ranks, SharedOutput output, RangeReduction& reduction,
                                                     std::size_t resolutions, const format::Histograms& histograms,
                                                     const std::string& folder, const BuildProgress& progress,
                                                     JointCells* cells = nullptr);

}  // namespace splatvol
