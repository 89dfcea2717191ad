// An output file that several ranks write at once.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/file.h"
#include "builder/distributed/ranks.h"

namespace splatvol {

/// One file, open on all ranks; rank 0 gives it its name. On one machine the file has no name before. Else it has a
/// temporary one beside the output, which every rank removes if a signal ends it (base/temporary_names.h).
class SharedOutput {
 public:
  /// Collective. Fails as AtomicFile::create, and if a rank cannot open the file: all ranks must see the output's
  /// folder under one name.
  [[nodiscard]] static Result<SharedOutput> create(Ranks& ranks, const std::string& target);
  SharedOutput(SharedOutput&& other) noexcept;
  SharedOutput& operator=(SharedOutput&&) = delete;
  ~SharedOutput();

  /// Writes bytes at `offset`. Ranks write to different places. The disk begins to write them.
  [[nodiscard]] Status write_at(std::uint64_t offset, std::span<const std::byte> bytes);

  /// The path by which this rank can read the file before it has its name.
  [[nodiscard]] std::string path_to_read() const { return fmt::format("/proc/self/fd/{}", descriptor_); }

  /// Waits until the other ranks see what this rank wrote: if they run on other machines, until the disk has it.
  [[nodiscard]] Status sync() const;

  /// The file, to be finished and committed. Rank 0 only, once.
  [[nodiscard]] AtomicFile take_file() { return std::move(*file_); }

 private:
  SharedOutput(std::string target, std::optional<AtomicFile> file, bool on_one_machine)
      : target_(std::move(target)), file_(std::move(file)), on_one_machine_(on_one_machine) {}
  [[nodiscard]] static Status open_on_all(Ranks& ranks, SharedOutput& output, bool named);

  std::string target_;
  std::optional<AtomicFile> file_;  // rank 0
  std::string noted_;               // a temporary name that other ranks noted
  int descriptor_ = -1;
  bool on_one_machine_;
  std::uint64_t not_begun_ = 0;  // bytes that the disk was not told to write
};

}  // namespace splatvol
