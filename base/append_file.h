// A file that grows at its end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// A file that is open for appending. No other AppendFile has it open at the same time. Not thread-safe.
class AppendFile {
 public:
  /// Opens a regular file. Fails if it is missing or cannot be written, or if another program appends to it.
  [[nodiscard]] static Result<AppendFile> open(const std::string& path);
  AppendFile(AppendFile&& other) noexcept;
  AppendFile& operator=(AppendFile&&) = delete;
  ~AppendFile();

  /// Fills `out` with the bytes at `offset`. Fails unless all of them exist.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) const;

  /// Cuts the file off behind `bytes`, where the next `append` goes.
  [[nodiscard]] Status cut(std::uint64_t bytes);

  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Syncs what was appended to the disk, then overwrites the file's first bytes, and syncs again. With at most 512
  /// bytes, a disk writes them whole or not at all.
  [[nodiscard]] Status replace_front(std::span<const std::byte> bytes);

 private:
  AppendFile(int descriptor, std::string path) : descriptor_(descriptor), path_(std::move(path)) {}

  int descriptor_;
  std::string path_;
  std::uint64_t end_ = 0;
};

}  // namespace splatvol
