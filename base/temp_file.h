// Temporary files, for data that does not fit into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// A file without a name. No other process can open it, and the system removes it however the process ends. Reads are
/// thread-safe; nothing else is.
class TempFile {
 public:
  /// Makes a file in `folder`. Fails if the folder cannot be written to.
  [[nodiscard]] static Result<TempFile> create(const std::string& folder);
  TempFile(TempFile&& other) noexcept;
  TempFile& operator=(TempFile&& other) noexcept;
  ~TempFile();

  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Fills `out` with the bytes at `offset`. Fails unless all of them exist.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) const;

  /// Gives the disk space of [offset, offset + bytes) back, if the file system can; then these bytes read as zeros. The
  /// size stays.
  void release(std::uint64_t offset, std::uint64_t bytes);

  /// Returns how many bytes were appended.
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  TempFile(int descriptor, std::string folder) : descriptor_(descriptor), folder_(std::move(folder)) {}

  int descriptor_;
  std::string folder_;
  std::uint64_t size_ = 0;
};

/// The failure of a reader that finds another checksum than the writer did.
[[nodiscard]] inline tl::unexpected<Error> fail_changed_temporary() {
  return fail(ErrorCode::io, "a temporary file holds other bytes than were written to it: is the disk faulty?");
}

/// Returns how many bytes can still be written in `folder`.
[[nodiscard]] Result<std::uint64_t> free_disk_bytes(const std::string& folder);

}  // namespace splatvol
