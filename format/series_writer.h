// Puts the steps of a time series into its file (spec/svol-1.md, section 11).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/layout.h"
#include "format/step_writer.h"
#include "format/volume.h"

namespace splatvol::format {

/// The steps of a series while they are written, one behind the other.
class StepDirectory {
 public:
  /// `attributes`: how many every step has. The first step begins at `offset`.
  StepDirectory(std::size_t attributes, std::uint64_t offset);

  /// Continues the directory of a file: its steps stay where they are, and its directory and footer become a dead part,
  /// with `hash`.
  StepDirectory(const Volume& volume, std::uint64_t hash);

  /// Writes a step. Fails if its time is not behind that of the step before.
  [[nodiscard]] Status write(StepWriter& step, const StepWriter::Append& append);

  /// The offset behind the last step.
  [[nodiscard]] std::uint64_t end() const { return end_; }
  [[nodiscard]] Bytes pack() const;

 private:
  std::vector<StepEntry> entries_;
  std::vector<StepRange> ranges_;  // [attribute]
  std::uint64_t end_;
};

/// Returns the footer of a file with this superblock and section table.
[[nodiscard]] Footer make_footer(std::uint64_t file_bytes, std::uint64_t table_hash);

/// What an append did.
struct Appended {
  std::uint64_t file_bytes;
  bool is_locked;  // false: the file system has no locks, so that another program could append at the same time
};

/// Appends steps to the series in a file. Writes them behind the file's end, and then changes the superblock: until
/// then, and if this is interrupted, the file stays as it was, with bytes behind its end. Cuts off the bytes that an
/// interrupted append has left. Fails if:
/// - the file is not the series that `volume` has open, because it was changed, or another program appends to it;
/// - the first time is not behind that of the last step;
/// - the file cannot be written. From the first byte of the superblock on, nothing is cut off: the steps may be in the
///   file, and the message says so.
[[nodiscard]] Result<Appended> append_steps(const std::string& path, const Volume& volume,
                                            std::span<const std::unique_ptr<StepWriter>> steps);

}  // namespace splatvol::format
