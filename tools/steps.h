// The options of programs that show a time step.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "format/steps.h"
#include "tools/command_line.h"

namespace splatvol {

/// Which step of a time series to show; the last if neither is set.
struct StepChoice {
  std::optional<double> time;       // the step nearest to it
  std::optional<std::size_t> step;  // its number
};

/// The numbers of steps, both inclusive.
struct StepRange {
  std::size_t first, last;
};

/// Reads "all" or "A:B"; without A or B, the range begins or ends where the series does. Fails if `count` steps do not
/// have this range.
[[nodiscard]] Result<StepRange> parse_steps(const std::string& text, std::size_t count);

/// An OptionCheck: whether parse_steps can read a text.
[[nodiscard]] std::string check_step_range(const std::string& text);

/// Adds the argument FILE: a .svol file, an index, or an address.
void add_file_argument(CommandLine& app, std::string& file);

/// Adds --time and --step.
void add_step_options(CommandLine& app, StepChoice& choice);

/// Opens the steps of a .svol file or an index (.svols), by its path or address.
[[nodiscard]] Result<format::Steps> open_steps(const std::string& path);

/// Returns the number of the chosen step; 0 without a choice if the file is no time series. Fails if there is no such
/// step.
[[nodiscard]] Result<std::size_t> find_step(const format::Steps& steps, const StepChoice& choice);

/// If the chosen step does not have the time that was asked for, prints that it is the nearest. `name` begins the line.
void tell_nearest(const std::string& name, const format::Steps& steps, const StepChoice& choice, std::size_t step);

/// Opens the chosen step of a file or an index.
[[nodiscard]] Result<std::shared_ptr<const format::Volume>> open_step(const std::string& path,
                                                                      const StepChoice& choice);

}  // namespace splatvol
