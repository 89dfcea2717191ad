// The time steps of inputs.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"
#include "builder/sources/step_group.h"

namespace splatvol {

/// Times of a series, both inclusive.
struct TimeRange {
  double first, last;
};

/// Reads "all" or "A:B"; without A or B, the range has no such end.
[[nodiscard]] Result<TimeRange> parse_times(const std::string& text);

/// How inputs are opened, and their headers read.
struct InputReader {
  OpenSource open;
  ListArrays list;
};

/// Returns the steps of an input that holds several, with times in the range. Fails if there is none. `series`: as for
/// make_steps.
[[nodiscard]] Result<std::vector<SeriesStep>> steps_of_input(const std::vector<std::string>& inputs,
                                                             const SourceOptions& options, const TimeRange& times,
                                                             const InputReader& reader,
                                                             const std::vector<std::string>& series = {});

/// Returns each input, and each file of a folder, as a step. `series`: as for make_steps.
[[nodiscard]] Result<std::vector<SeriesStep>> steps_of_files(const std::vector<std::string>& inputs,
                                                             const SourceOptions& options, const InputReader& reader,
                                                             const std::vector<std::string>& series = {});

}  // namespace splatvol
