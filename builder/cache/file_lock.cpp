#include "builder/cache/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "base/descriptor.h"

namespace splatvol {

// NFS locks for one process only what is open for writing.
Result<std::optional<FileLock>> FileLock::lock(const std::string& path, Kind kind, int waits) {
  const bool alone = kind == Kind::exclusive;
  const int flags = O_CLOEXEC | O_NONBLOCK | (alone ? O_RDWR | O_CREAT : O_RDONLY);
  const int descriptor = uninterrupted([&] { return ::open(path.c_str(), flags, 0600); });
  if (descriptor < 0) return fail_errno(path, "cannot open");
  FileLock file(descriptor, true);
  if (uninterrupted([&] { return ::flock(descriptor, (alone ? LOCK_EX : LOCK_SH) | waits); }) == 0)
    return std::optional(std::move(file));
  if (errno == EWOULDBLOCK) return std::optional<FileLock>();
  if (errno != ENOLCK && errno != ENOSYS && errno != EOPNOTSUPP) return fail_errno(path, "cannot lock");
  file.is_real_ = false;
  return std::optional(std::move(file));
}

Result<std::optional<FileLock>> FileLock::try_lock(const std::string& path, Kind kind) {
  return lock(path, kind, LOCK_NB);
}

Result<FileLock> FileLock::wait_for(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(locked, lock(path, Kind::exclusive, 0));
  return std::move(*locked);
}

FileLock::FileLock(FileLock&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), is_real_(other.is_real_) {}

FileLock& FileLock::operator=(FileLock&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(is_real_, other.is_real_);
  return *this;
}

FileLock::~FileLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

}  // namespace splatvol
