// The time steps of a file, or of files with an index.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "format/layout.h"
#include "format/volume.h"

namespace splatvol::format {

/// Opens a file by its path or address.
using OpenFile = std::function<Result<std::unique_ptr<ByteSource>>(const std::string& path)>;

/// A .svol file, or the index (.svols) of a time series whose steps are files. Both play alike.
class Steps {
 public:
  /// `path`: of the file or the index, for `open`. Reads the file's preamble, or the index and no step. Fails if the
  /// file is damaged, or the index is none.
  [[nodiscard]] static Result<Steps> open(const std::string& path, OpenFile open);

  /// The name of the file or the index, for messages.
  [[nodiscard]] const std::string& name() const { return name_; }

  /// The times of the steps, which rise; none if the file is no time series.
  [[nodiscard]] const std::vector<double>& times() const { return times_; }

  /// The number of the last step; 0 if the file is no time series.
  [[nodiscard]] std::size_t last() const { return times_.empty() ? 0 : times_.size() - 1; }

  /// The number of the step nearest to a time; of two, the earlier. 0 if the file is no time series.
  [[nodiscard]] std::size_t nearest(double time) const;

  /// The names of the attributes; of an index, of those that all steps have.
  [[nodiscard]] const std::vector<std::string>& attributes() const { return names_; }

  /// Whether each step is a file of its own.
  [[nodiscard]] bool are_files() const { return !files_.empty(); }

  /// Opens a step; 0 if the file is no time series. Requires a step that is there. Fails if its file is damaged, or is
  /// not what the index says. Thread-safe.
  [[nodiscard]] Result<std::shared_ptr<const Volume>> volume(std::size_t step) const;

  /// Checks every byte of the file, as Volume::verify does. Of an index, checks the files of all steps, and that the
  /// index gives the units of their attributes and the ranges over all of them.
  [[nodiscard]] Status verify(const std::function<void(double)>& progress, std::size_t threads = 1) const;

  /// Returns the range of an attribute's values over all steps; of a file that is no series, its range. NaN if no value
  /// is present, or there is no such attribute.
  [[nodiscard]] StepRange range_of(const std::string& attribute) const;

 private:
  Steps(std::string path, OpenFile open) : path_(std::move(path)), open_(std::move(open)) {}
  [[nodiscard]] Status open_index();
  [[nodiscard]] Status check_attributes(const Volume& volume) const;
  [[nodiscard]] Status check_units(const Volume& volume) const;

  std::string path_, name_;
  OpenFile open_;
  std::vector<double> times_;
  std::vector<std::string> files_;        // of an index
  std::shared_ptr<const Volume> volume_;  // of a single file
  std::vector<std::string> names_;        // [attribute]
  std::vector<std::string> units_;        // [attribute], of an index
  std::vector<StepRange> ranges_;         // [attribute]
};

}  // namespace splatvol::format
