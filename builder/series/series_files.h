// Builds a time series whose steps are files of their own.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "builder/sources/step_group.h"

namespace splatvol {

/// Builds a file for each step, and then their index (format/series_index.h). Meshes may change from step to step.
/// `output` ends in .svols; the files lie in its folder and have its name with the number of the step: flow-0000.svol.
/// Times are those of build_series. With `append`, continues the index that is there. The files have temporary names
/// until all are built. After a failure, those that this call has made are removed, and the index is as it was; only if
/// the disk does not confirm the new index, all stays, and the message says so.
///
/// Several programs may append at once: the index is locked, and read again, while it changes. Each takes the next free
/// number, and fails if its time is not behind that of the last step then. Numbers that other files have are left out
/// (SeriesReport::warnings).
[[nodiscard]] Result<SeriesReport> build_series_of_files(const std::vector<SeriesStep>& steps,
                                                         const std::string& output, bool append,
                                                         const BuildOptions& options, const BuildProgress& progress);

}  // namespace splatvol
