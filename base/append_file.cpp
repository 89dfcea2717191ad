#include "base/append_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "base/descriptor.h"

namespace splatvol {
namespace {

tl::unexpected<Error> fail_errno(const std::string& path, const char* action) {
  return fail(ErrorCode::io, "{}: {}: {}", path, action, std::strerror(errno));
}

}  // namespace

Result<AppendFile> AppendFile::open(const std::string& path) {
  const int descriptor = ::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return fail_errno(path, "cannot open for appending");
  AppendFile file(descriptor, path);
  struct stat status {};
  if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode))
    return fail(ErrorCode::io, "{}: not a regular file", path);
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    return fail(ErrorCode::io, "{}: another program appends to it", path);
  file.end_ = static_cast<std::uint64_t>(status.st_size);
  return file;
}

AppendFile::AppendFile(AppendFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), path_(std::move(other.path_)), end_(other.end_) {}

AppendFile::~AppendFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

Status AppendFile::read(std::uint64_t offset, std::span<std::byte> out) const {
  if (read_fully(descriptor_, offset, out)) return {};
  if (errno == 0) return fail(ErrorCode::io, "{}: the file became shorter while it was open", path_);
  return fail_errno(path_, "cannot read");
}

Status AppendFile::cut(std::uint64_t bytes) {
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0) return fail_errno(path_, "cannot cut off");
  end_ = bytes;
  return {};
}

Status AppendFile::append(std::span<const std::byte> bytes) {
  if (!write_fully(descriptor_, end_, bytes)) return fail_errno(path_, "cannot write");
  end_ += bytes.size();
  return {};
}

Status AppendFile::replace_front(std::span<const std::byte> bytes) {
  if (::fsync(descriptor_) != 0) return fail_errno(path_, "cannot sync");
  if (!write_fully(descriptor_, 0, bytes)) return fail_errno(path_, "cannot write");
  return ::fsync(descriptor_) == 0 ? Status{} : fail_errno(path_, "cannot sync");
}

}  // namespace splatvol
