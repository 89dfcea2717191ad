// Locks on files, which end with the process that has them.
#pragma once

#include <optional>
#include <string>

#include "base/error.h"

namespace splatvol {

/// A file that is open and locked, by flock(). Programs that do not ask for the lock are not kept away. Where the file
/// system has no locks, each lock is granted. Not thread-safe.
class FileLock {
 public:
  enum class Kind { shared, exclusive };

  /// Locks a file. Returns nothing if another lock is in the way. Fails if the file cannot be opened; an exclusive lock
  /// makes a file that is not there.
  [[nodiscard]] static Result<std::optional<FileLock>> try_lock(const std::string& path, Kind kind);

  /// Locks a file for this process alone, and waits for that.
  [[nodiscard]] static Result<FileLock> wait_for(const std::string& path);

  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&& other) noexcept;
  ~FileLock();

  /// False where the file system has no locks.
  [[nodiscard]] bool is_real() const { return is_real_; }

 private:
  FileLock(int descriptor, bool is_real) : descriptor_(descriptor), is_real_(is_real) {}
  [[nodiscard]] static Result<std::optional<FileLock>> lock(const std::string& path, Kind kind, int waits);

  int descriptor_;
  bool is_real_;
};

}  // namespace splatvol
