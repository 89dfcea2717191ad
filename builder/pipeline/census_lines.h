// The report of a build on its input, in words.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/pipeline/build.h"
#include "builder/points/input_summary.h"

namespace splatvol {

/// A count of cells, points or values.
struct CensusLine {
  std::string words;
  std::uint64_t count = 0;
  bool is_change = false;  // the file lacks these, or has them otherwise than the input
};

/// The counts that are not 0.
[[nodiscard]] std::vector<CensusLine> census_lines(const BuildReport& report);

/// Returns a line if positions lose their detail: far from the origin for the distance between them, or in a reader.
[[nodiscard]] std::vector<std::string> precision_warnings(const InputSummary& input);

/// Returns the attributes with values too small beside the largest. `exact`: values are stored as they are, in single
/// precision.
[[nodiscard]] LostValues lost_values(const InputSummary& input, bool exact);

/// Adds those of other steps.
void add_lost(const LostValues& more, LostValues& lost);

/// The warnings of a report, each in a line.
[[nodiscard]] std::vector<std::string> warning_lines(const BuildReport& report);

/// Fails if the file is not the whole input as it is (CensusLine::is_change), or if there are warnings.
[[nodiscard]] Status check_unchanged(const BuildReport& report);

}  // namespace splatvol
