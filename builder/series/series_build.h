// Builds a time series in one file, and appends steps to it.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/pipeline/build.h"
#include "builder/sources/step_group.h"

namespace splatvol {

struct SeriesReport {
  BuildReport build;                          // of the first steps, but for what add_report adds, and the file's size
  std::vector<double> times;                  // of the steps that were written
  std::vector<std::string> conversions = {};  // Source::conversions() of all steps, each line once
  std::vector<std::string> warnings = {};     // about the file or the files, not about the input
};

/// Adds what the build of further steps tells. By attribute, numbers of values add up, and the first warning stays. Of
/// points that are unlike, the largest number stays.
void add_report(SeriesReport& series, const BuildReport& steps, const std::vector<std::string>& conversions);

/// Builds a time series: one file with one mesh and the values of all steps. A step without a time gets the time that
/// its source states; if no step has one, its number, counted from 0. `output` appears whole or not at all. Reduces as
/// many steps at a time as memory allows; the result does not depend on how many. Fails as build_volume, and if the
/// steps have different meshes or attributes, or times that do not rise.
[[nodiscard]] Result<SeriesReport> build_series(std::vector<SeriesStep> steps, const std::string& output,
                                                const BuildOptions& options, const BuildProgress& progress);

/// Appends steps to a series. The file stays as it was if this fails or is interrupted, unless the last of all writes
/// fails (format::append_steps). Reduction, leaf size and chunk size are those of the file. Fails as build_series, and
/// if the steps have another mesh than the file.
[[nodiscard]] Result<SeriesReport> append_to_series(std::vector<SeriesStep> steps, const std::string& path,
                                                    BuildOptions options, const BuildProgress& progress);

}  // namespace splatvol
