// Builds a .svol file by several processes.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "builder/distributed/ranks.h"
#include "builder/pipeline/build.h"
#include "builder/sources/source.h"

namespace splatvol {

/// The result of a joint build, and the work of its ranks.
struct JointReport {
  BuildReport build;
  std::size_t ranks = 1;
  std::size_t ranges = 1;                 // ranks that reduced points of their own
  std::uint64_t record_bytes = 0;         // of all records
  std::uint64_t sent_bytes = 0;           // between all ranks
  std::vector<std::uint64_t> owned = {};  // [rank]: bytes of the records that it sorted
};

/// Collective: does what build_volume does, by all ranks together. The file is the same to the last byte, for any
/// number of ranks. Each rank holds `options.memory`, beside a piece of the input. `open` opens the whole input, on
/// each rank; `source` gets it. All ranks return the same result: a failure of one is the failure of all.
///
/// Ranks read pieces in turn. If cells join the points, or boxes, and there are more than 2^19, and with
/// Reduction::octree, each rank sorts and reduces a range of Morton keys. Else rank 0 alone does what comes after
/// reading.
[[nodiscard]] Result<JointReport> build_volume_together(Ranks& ranks,
                                                        const std::function<Result<std::unique_ptr<Source>>()>& open,
                                                        std::unique_ptr<Source>& source, const std::string& output,
                                                        const BuildOptions& options, const BuildProgress& progress);

}  // namespace splatvol
