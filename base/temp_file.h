// Room on the disk for what does not fit into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// A file without a name: nobody else can open it, and the system takes it back with the descriptor, however the
/// process ends. Reads are thread-safe; nothing else is.
class TempFile {
 public:
  /// In `folder`; fails where that cannot be written to.
  [[nodiscard]] static Result<TempFile> create(const std::string& folder);
  TempFile(TempFile&& other) noexcept;
  TempFile& operator=(TempFile&& other) noexcept;
  ~TempFile();

  /// Appends bytes at the end.
  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Fills `out` with the bytes at `offset`; fails unless all of them exist.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) const;

  /// Gives the disk space of [offset, offset + bytes) back, where the file system can: what is read there afterwards is
  /// zeros. The size stays.
  void release(std::uint64_t offset, std::uint64_t bytes);

  /// Bytes appended.
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  TempFile(int descriptor, std::string folder) : descriptor_(descriptor), folder_(std::move(folder)) {}

  int descriptor_;
  std::string folder_;
  std::uint64_t size_ = 0;
};

/// Bytes that can still be written in `folder`.
[[nodiscard]] Result<std::uint64_t> free_disk_bytes(const std::string& folder);

}  // namespace splatvol
