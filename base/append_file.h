// A file that grows at its end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "base/error.h"
#include "base/locked_file.h"

namespace splatvol {

/// A file that is open for appending. No other AppendFile has it open at the same time, where the file system has
/// locks. Not thread-safe.
class AppendFile {
 public:
  /// Opens a regular file. Fails if it is missing or cannot be written, or if another program appends to it.
  [[nodiscard]] static Result<AppendFile> open(const std::string& path);

  /// False if the file system has no locks.
  [[nodiscard]] bool is_locked() const { return file_.is_locked(); }

  /// Fills `out` with the bytes at `offset`. Fails unless all of them exist.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) const;

  /// Cuts the file off behind `bytes`, where the next `append` goes.
  [[nodiscard]] Status cut(std::uint64_t bytes);

  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Waits until the disk has all that was written. A failure stays one: a second call cures nothing.
  [[nodiscard]] Status sync();

  /// Overwrites the file's first bytes. A disk writes at most 512 bytes whole or not at all. After a failure, the file
  /// may have the old bytes, the new ones, or some of both.
  [[nodiscard]] Status replace_front(std::span<const std::byte> bytes);

 private:
  AppendFile(LockedFile file, std::string path) : file_(std::move(file)), path_(std::move(path)) {}

  LockedFile file_;
  std::string path_;
  std::uint64_t end_ = 0;
};

}  // namespace splatvol
