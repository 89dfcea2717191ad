// The time steps of inputs.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/step_group.h"

namespace splatvol {

/// Times of a series, both inclusive.
struct TimeRange {
  double first, last;
};

/// Reads "all" or "A:B"; without A or B, the range has no such end.
[[nodiscard]] Result<TimeRange> parse_times(const std::string& text);

/// Returns the steps of an input that holds several, with times in the range. Fails if there is none.
[[nodiscard]] Result<std::vector<SeriesStep>> steps_of_input(const std::vector<std::string>& inputs,
                                                             const SourceOptions& options, const TimeRange& times,
                                                             const OpenSource& open);

/// Returns each input, and each file of a folder, as a step.
[[nodiscard]] Result<std::vector<SeriesStep>> steps_of_files(const std::vector<std::string>& inputs,
                                                             const SourceOptions& options, const OpenSource& open);

/// Returns `open` for steps that are appended to `series` and have the attributes of it. Opening fails if one of these
/// is the magnitude of a vector, whose components are not in the series: it is not known to be of a vector there.
[[nodiscard]] OpenSource open_for_series(OpenSource open, std::string series);

}  // namespace splatvol
