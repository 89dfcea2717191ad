// A file that programs change one after another.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// A regular file that is open for reading and writing, and locked: no other LockedFile has it open at the same time,
/// in any process. Programs that do not ask for the lock are not kept away. Not thread-safe.
class LockedFile {
 public:
  enum class IfTaken { wait, fail };  // if another program has the lock

  /// Opens the file that has the name `path` once the lock is there: another program may give the name to another file
  /// meanwhile. Fails if there is none, or if it cannot be written.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path, IfTaken if_taken);
  LockedFile(LockedFile&& other) noexcept;
  LockedFile& operator=(LockedFile&&) = delete;
  ~LockedFile();

  [[nodiscard]] int descriptor() const { return descriptor_; }

  /// False if the file system has no locks.
  [[nodiscard]] bool is_locked() const { return is_locked_; }

 private:
  explicit LockedFile(int descriptor) : descriptor_(descriptor) {}
  [[nodiscard]] static Result<LockedFile> open_once(const std::string& path, IfTaken if_taken);

  int descriptor_;
  bool is_locked_ = false;
};

/// The warning about a file whose file system has no locks.
[[nodiscard]] std::string without_lock_warning(const std::string& path);

}  // namespace splatvol
