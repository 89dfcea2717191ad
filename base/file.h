// Reads and writes bytes. ByteSource hides where a file is. AtomicFile appears whole or not at all.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"

namespace splatvol {

/// Bytes of a file, from `begin` up to `end`.
struct ByteRange {
  std::uint64_t begin = 0, end = 0;

  [[nodiscard]] bool operator==(const ByteRange&) const = default;
};

/// Random access to the bytes of a file, wherever the file is. Implementations are thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// Returns the size of the file in bytes.
  [[nodiscard]] virtual std::uint64_t size() const = 0;

  /// Fills `out` with the bytes at `offset`. Fails unless all of them exist and were read.
  [[nodiscard]] virtual Status read(std::uint64_t offset, std::span<std::byte> out) = 0;

  /// Whether reads wait for their bytes. Else a read of bytes that have not come fails with ErrorCode::pending, and is
  /// to be tried again later.
  [[nodiscard]] virtual bool waits() const { return true; }

  /// Begins to fetch ranges, unless reads wait. Returns false if some have not come: a read would fail.
  [[nodiscard]] virtual bool prefetch(std::span<const ByteRange> /*ranges*/) { return true; }

  /// Largest gap between two wanted ranges, in bytes, that is cheaper to read through than to skip.
  [[nodiscard]] virtual std::uint64_t cheap_gap() const { return 1024; }

  /// Name for messages: a path or an address.
  [[nodiscard]] virtual const std::string& name() const = 0;

  /// Bytes at an offset, and where they go.
  struct Part {
    std::uint64_t offset;
    std::span<std::byte> out;
  };

  /// Fills several parts by one request to a server. Requires ascending parts that do not overlap, in the file. Returns
  /// false if the source cannot do so: then each is to be read by itself.
  [[nodiscard]] virtual Result<bool> read_parts(std::span<const Part> /*parts*/) { return false; }

  /// Whether read_parts may do so.
  [[nodiscard]] virtual bool may_read_parts() const { return false; }
};

/// Fails with invalid_data unless the source has the bytes [offset, offset + count).
[[nodiscard]] Status check_range(const ByteSource& source, std::uint64_t offset, std::uint64_t count);

/// Whether a file is named by an address (http://, https:// or ssh://) and not by a path.
[[nodiscard]] inline bool is_url(std::string_view path_or_url) {
  return path_or_url.starts_with("http://") || path_or_url.starts_with("https://") || path_or_url.starts_with("ssh://");
}

[[nodiscard]] std::string folder_of(const std::string& path);

/// Makes a folder, and those that it lies in, unless it is there.
[[nodiscard]] Status make_folder(const std::string& path);

/// Opens a regular file for positional reads.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);

/// Reads a whole file of at most 64 MiB. Fails if it is larger, missing, unreadable or not a regular file.
[[nodiscard]] Result<std::string> read_text_file(const std::string& path);

/// Who may do what with a file.
struct FileRights {
  mode_t mode;
  uid_t owner;
  gid_t group;
};

/// A file that gets its name only when it is complete.
///
/// Bytes go to a file without a name, in the folder of `target`; the system removes it however the process ends. Some
/// file systems have no such files: there it has a temporary name, and the destructor removes it, or a program's signal
/// handler (base/temporary_names.h). `commit` syncs the
/// file to the disk and names it `target`; until then a file that had this name stays as it was. Not thread-safe.
class AtomicFile {
 public:
  /// Whether the file has no name before `commit`. Tests choose `never`, which is what some file systems force.
  enum class Unnamed { if_possible, never };

  /// Fails if the folder cannot be written to, or if `target` exists and is not a regular file. Fails also if `target`
  /// may not be replaced (check_replaceable in base/replaceable.h), and so does `commit`. If `target` is a link,
  /// replaces the file that it points to. A file that is replaced keeps its rights, and its owner and group where the
  /// system allows it; until `commit`, only the user may read the new one.
  [[nodiscard]] static Result<AtomicFile> create(const std::string& target, Unnamed unnamed = Unnamed::if_possible,
                                                 Replace replace = Replace::exports);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  /// Appends bytes. The disk begins to write them before `commit`.
  [[nodiscard]] Status append(std::span<const std::byte> bytes);

  /// Overwrites bytes at `offset`. A gap in front of them reads as zeros. Does not move `position`.
  [[nodiscard]] Status write_at(std::uint64_t offset, std::span<const std::byte> bytes);

  /// Moves the content and `position` towards the end by `bytes`; the content of the gap is unspecified. Copies nothing
  /// if the file system can insert ranges (ext4, XFS) and `bytes` is a multiple of insertable_bytes.
  [[nodiscard]] Status insert_front(std::uint64_t bytes);
  static constexpr std::uint64_t insertable_bytes = 4096;

  /// Sets the offset of the next `append`.
  void seek(std::uint64_t offset) { end_ = begun_ = offset; }

  /// Offset of the next `append`.
  [[nodiscard]] std::uint64_t position() const { return end_; }

  /// Path to the file for libraries that open files by name. Valid until `commit`, in this process only.
  [[nodiscard]] std::string path_to_write() const;

  /// Syncs the file to the disk, gives it its name, and waits until the disk has the name too. Fails if the system
  /// refuses. If it refuses the name, the finished file stays beside `target`, and the message tells where. If the disk
  /// does not confirm the name, the file has it all the same, and the message tells so. A name that is noted as
  /// temporary (base/temporary_names.h) is not waited for. Only destruction is allowed afterwards.
  [[nodiscard]] Status commit();

  /// The same without the last wait: until sync_folder(), a power cut may take the name back. After a failure nothing
  /// has changed, and nothing stays. Only destruction is allowed afterwards.
  [[nodiscard]] Status commit_unconfirmed();

 private:
  AtomicFile(int descriptor, std::string path, std::string temporary_path, const std::optional<FileRights>& rights);
  [[nodiscard]] static Result<AtomicFile> create_beside(const std::string& path, Unnamed unnamed,
                                                        const std::optional<FileRights>& rights);
  [[nodiscard]] Status complete();
  [[nodiscard]] Status give_temporary_name();
  [[nodiscard]] Status copy_to_named();
  [[nodiscard]] bool rename_to_target();

  int descriptor_;
  std::string path_;
  std::string temporary_path_;        // empty: the file has no name
  std::optional<FileRights> rights_;  // of the file that it replaces
  std::uint64_t end_ = 0;
  std::uint64_t begun_ = 0;  // the disk was told to write the bytes before this offset
  Replace replace_ = Replace::exports;
};

/// Waits until the disk has the names of the files in a folder. Succeeds where the file system cannot, and in a folder
/// that may not be listed.
[[nodiscard]] Status sync_folder(const std::string& folder);

/// Renames a file in its folder. Returns false if another file has the name `to`, which stays.
[[nodiscard]] Result<bool> rename_if_free(const std::string& from, const std::string& to);

/// Writes a whole file through an AtomicFile.
[[nodiscard]] Status write_text_file(const std::string& path, const std::string& text);

}  // namespace splatvol
