// The time steps of a file, for the programs that show one.
#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/volume.h"

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

/// Checks for CLI11 whether parse_steps can read a text.
[[nodiscard]] std::string check_step_range(const std::string& text);

/// Adds --time and --step.
void add_step_options(CLI::App& app, StepChoice& choice);

/// A .svol file, or the index (.svols) of a time series whose steps are files. Both play alike.
class Steps {
 public:
  /// `path`: of the file, or its address.
  [[nodiscard]] static Result<Steps> open(const std::string& path);

  /// The times of the steps; none if the file is no time series.
  [[nodiscard]] const std::vector<double>& times() const { return times_; }

  /// Returns the number of the chosen step; 0 without a choice if the file is no time series. Fails if there is no such
  /// step.
  [[nodiscard]] Result<std::size_t> find(const StepChoice& choice) const;

  /// Opens a step that `find` returned.
  [[nodiscard]] Result<std::shared_ptr<const format::Volume>> volume(std::size_t step) const;

  /// Opens the chosen step.
  [[nodiscard]] Result<std::shared_ptr<const format::Volume>> volume(const StepChoice& choice) const;

 private:
  explicit Steps(std::string path) : path_(std::move(path)) {}
  [[nodiscard]] Status open_index();

  std::string path_;
  std::vector<double> times_;
  std::vector<std::string> files_;                // of an index
  std::shared_ptr<const format::Volume> volume_;  // of a single file
};

}  // namespace splatvol
