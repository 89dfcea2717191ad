// Calls on file descriptors that signals do not end: bytes to and from them, all of them or none, and to the disk.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Returns the failure of a call of the system that has set errno: "PATH: ACTION: REASON".
[[nodiscard]] inline tl::unexpected<Error> fail_errno(const std::string& path, const char* action) {
  return fail(ErrorCode::io, "{}: {}: {}", path, action, std::strerror(errno));
}

/// Makes a call of the system until no signal interrupts it: file systems of networks and of programs (FUSE) may end
/// any call so. Not for close(), after which the descriptor is gone in any case.
template <class Call>
[[nodiscard]] auto uninterrupted(Call call) {
  for (;;)
    if (const auto result = call(); result != -1 || errno != EINTR) return result;
}

/// Writes all bytes at `offset`. Returns false, with errno set, if the system refuses.
[[nodiscard]] inline bool write_fully(int descriptor, std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t put =
        uninterrupted([&] { return ::pwrite(descriptor, bytes.data(), bytes.size(), static_cast<off_t>(offset)); });
    if (put == 0) errno = EIO;
    if (put <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    offset += static_cast<std::uint64_t>(put);
  }
  return true;
}

/// Fills `out` with the bytes at `offset`. Returns false if the system refuses, with errno set, or if the file ends
/// before, with errno 0.
[[nodiscard]] inline bool read_fully(int descriptor, std::uint64_t offset, std::span<std::byte> out) {
  while (!out.empty()) {
    const ssize_t got =
        uninterrupted([&] { return ::pread(descriptor, out.data(), out.size(), static_cast<off_t>(offset)); });
    if (got == 0) errno = 0;
    if (got <= 0) return false;
    out = out.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
  return true;
}

/// The same. Fails if not all of the bytes are there; `path` begins the message.
[[nodiscard]] inline Status read_exactly(int descriptor, std::uint64_t offset, std::span<std::byte> out,
                                         const std::string& path) {
  if (read_fully(descriptor, offset, out)) return {};
  if (errno == 0) return fail(ErrorCode::io, "{}: the file became shorter while it was open", path);
  return fail_errno(path, "cannot read");
}

/// Waits until the disk has the bytes. Returns false, with errno set, if it may lack some. A second call cannot cure
/// that: the system has forgotten which.
[[nodiscard]] inline bool sync_fully(int descriptor) {
  return uninterrupted([&] { return ::fsync(descriptor); }) == 0;
}

/// Whether `path` names the file that is open. Opens it: stat() may answer from what a client of NFS remembers.
[[nodiscard]] inline bool is_named(int descriptor, const std::string& path) {
  const int named = uninterrupted([&] { return ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); });
  if (named < 0) return false;
  struct stat own {
  }, other{};
  const bool same = ::fstat(descriptor, &own) == 0 && ::fstat(named, &other) == 0 && own.st_dev == other.st_dev &&
                    own.st_ino == other.st_ino;
  ::close(named);
  return same;
}

}  // namespace splatvol
