// Builds a time series whose steps are files of their own.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/build.h"
#include "builder/series_build.h"
#include "builder/sources/step_group.h"

namespace splatvol {

/// Builds a file for each step, and then their index (format/series_index.h). Meshes may change from step to step.
/// `output` ends in .svols; the files lie in its folder and have its name with the number of the step: flow-0000.svol.
/// Times are those of build_series. With `append`, continues the index that is there. Each file appears whole or not
/// at all; after a failure, those that this call has made are removed, and the index is as it was.
[[nodiscard]] Result<SeriesReport> build_series_of_files(const std::vector<SeriesStep>& steps,
                                                         const std::string& output, bool append,
                                                         const BuildOptions& options, const BuildProgress& progress);

}  // namespace splatvol
