#include "base/locked_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "base/descriptor.h"

namespace splatvol {

// NFS locks only what is open for writing. Without O_NONBLOCK, opening a pipe could wait for ever.
Result<LockedFile> LockedFile::open_once(const std::string& path, IfTaken if_taken) {
  const int descriptor = uninterrupted([&] { return ::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK); });
  if (descriptor < 0) return fail_errno(path, "cannot open for appending");
  LockedFile file(descriptor);
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode))
    return fail(ErrorCode::io, "{}: not a regular file", path);
  const int operation = LOCK_EX | (if_taken == IfTaken::fail ? LOCK_NB : 0);
  file.is_locked_ = uninterrupted([&] { return ::flock(descriptor, operation); }) == 0;
  if (file.is_locked_ || errno == ENOLCK || errno == ENOSYS || errno == EOPNOTSUPP) return file;
  if (errno == EWOULDBLOCK) return fail(ErrorCode::io, "{}: another program appends to it", path);
  return fail_errno(path, "cannot lock");
}

Result<LockedFile> LockedFile::open(const std::string& path, IfTaken if_taken) {
  for (;;) {
    SPLATVOL_TRY_ASSIGN(file, open_once(path, if_taken));
    if (!file.is_locked() || is_named(file.descriptor(), path)) return file;
  }
}

LockedFile::LockedFile(LockedFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), is_locked_(other.is_locked_) {}

LockedFile::~LockedFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::string without_lock_warning(const std::string& path) {
  return fmt::format("{}: its file system has no locks: let no two programs append to it at once", path);
}

}  // namespace splatvol
