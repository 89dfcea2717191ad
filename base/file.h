// Bytes in and out: the seam between readers and storage, and files that appear whole or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Random access to the bytes of a file, wherever they are. Implementations are thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// Number of bytes that can be read.
  [[nodiscard]] virtual std::uint64_t size() const = 0;

  /// Fills `out` with the bytes at `offset`; fails unless all of them exist and were read.
  [[nodiscard]] virtual Status read(std::uint64_t offset, std::span<std::byte> out) = 0;

  /// How many bytes are sooner read along with others than left for a read of their own.
  [[nodiscard]] virtual std::uint64_t cheap_gap() const { return 1024; }

  /// What to call it in messages: a path or an address.
  [[nodiscard]] virtual const std::string& name() const = 0;
};

/// The folder that a file is in.
[[nodiscard]] std::string folder_of(const std::string& path);

/// Opens a regular file for positional reads.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);

/// Serves bytes held in memory; `name` appears in messages.
[[nodiscard]] std::unique_ptr<ByteSource> memory_source(std::span<const std::byte> bytes, std::string name);

/// Reads a whole file of at most 64 MiB; fails with one line where it is missing, unreadable or not a regular file.
[[nodiscard]] Result<std::string> read_text_file(const std::string& path);

/// A file that gets its name only when it is complete.
///
/// Bytes go to a file without a name in the same folder, which the system takes back however the process ends (where
/// the file system cannot make one, to a temporary name, which the destructor removes); `commit` syncs it to the disk
/// and puts it in the place of `path`. Without commit, whatever stood at `path` is untouched. Not thread-safe.
class AtomicFile {
 public:
  /// Fails where the folder cannot be written to, or where `target` is something else than a regular file. A link is
  /// followed: what it points to is replaced.
  [[nodiscard]] static Result<AtomicFile> create(const std::string& target);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  /// Appends bytes at the end. The disk begins to write them before `commit`.
  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Overwrites bytes at `offset`; a hole left before it reads as zeros. Does not move the end of `append`.
  [[nodiscard]] Status write_at(std::uint64_t offset, std::span<const std::byte> bytes);

  /// Moves all bytes back by `bytes`, and the end of `append`; what is in front means nothing then. Nothing is copied
  /// where the file system can insert blocks (ext4, XFS) and `bytes` is a multiple of insertable_bytes.
  [[nodiscard]] Status insert_front(std::uint64_t bytes);
  static constexpr std::uint64_t insertable_bytes = 4096;

  /// Moves the place of the next `append`.
  void seek(std::uint64_t offset) { end_ = begun_ = offset; }

  /// Place of the next `append`, bytes from the start.
  [[nodiscard]] std::uint64_t position() const { return end_; }

  /// Where libraries that write by name reach the bytes until `commit`, in this process.
  [[nodiscard]] std::string path_to_write() const;

  [[nodiscard]] Status commit();

 private:
  AtomicFile(int descriptor, std::string path, std::string temporary_path);

  int descriptor_;
  std::string path_;
  std::string temporary_path_;  // empty: none
  std::uint64_t end_ = 0;
  std::uint64_t begun_ = 0;  // what the disk has been told to write
};

/// Writes a whole file through an AtomicFile.
[[nodiscard]] Status write_text_file(const std::string& path, const std::string& text);

}  // namespace splatvol
