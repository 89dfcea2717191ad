// To be preloaded: a disk that fails once. Counts the calls of the system that change files or wait for the disk:
// - SPLATVOL_FAIL_CALL: the number of the call that fails, from 0. Without it, no call fails.
// - SPLATVOL_FAIL_EACH: all calls that count fail.
// - SPLATVOL_FAIL_ERROR: the number of its error, such as 5 for EIO.
// - SPLATVOL_FAIL_HALF: a pwrite of this number writes half of its bytes, and the call after it fails.
// - SPLATVOL_FAIL_ONLY: counts the calls of this name only, such as flock, which else does not count.
// - SPLATVOL_FAIL_LOG: a file that gets the name of each call that counts, in a line.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

std::atomic<long> calls = 0;

long number_of(const char* name, long otherwise) {
  const char* text = std::getenv(name);
  return text ? std::strtol(text, nullptr, 10) : otherwise;
}

bool counts(const char* name) {
  const char* only = std::getenv("SPLATVOL_FAIL_ONLY");
  return only ? std::strcmp(only, name) == 0 : std::strcmp(name, "flock") != 0;
}

void log_call(const char* name) {
  const char* path = std::getenv("SPLATVOL_FAIL_LOG");
  if (!path) return;
  char line[64];
  const int length = std::snprintf(line, sizeof(line), "%s\n", name);
  const long file = ::syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  ::syscall(SYS_write, file, line, length);
  ::syscall(SYS_close, file);
}

// Returns how many calls are left until the one that fails: 0 for that one, -1 for others.
long left(const char* name) {
  if (!counts(name)) return -1;
  log_call(name);
  if (std::getenv("SPLATVOL_FAIL_EACH")) return 0;
  const long call = calls++;
  const bool in_half = std::getenv("SPLATVOL_FAIL_HALF") != nullptr;
  return number_of("SPLATVOL_FAIL_CALL", -2) + (in_half ? 1 : 0) - call;
}

bool is_refused(const char* name) {
  if (left(name) != 0) return false;
  errno = static_cast<int>(number_of("SPLATVOL_FAIL_ERROR", EIO));
  return true;
}

template <class Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
}

bool is_file(int descriptor) {
  struct stat status {};
  return ::fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
}

int open_by(const char* function, const char* path, int flags, mode_t mode) {
  const bool changes = (flags & O_ACCMODE) != O_RDONLY && std::strncmp(path, "/dev/", 5) != 0;
  if (changes && is_refused("open")) return -1;
  return next<int (*)(const char*, int, ...)>(function)(path, flags, mode);
}

ssize_t pwrite_by(const char* function, int descriptor, const void* bytes, size_t count, off_t offset) {
  const long calls_left = left("pwrite");
  if (calls_left == 0) {
    errno = static_cast<int>(number_of("SPLATVOL_FAIL_ERROR", EIO));
    return -1;
  }
  if (calls_left == 1 && std::getenv("SPLATVOL_FAIL_HALF")) count = (count + 1) / 2;
  return next<ssize_t (*)(int, const void*, size_t, off_t)>(function)(descriptor, bytes, count, offset);
}

}  // namespace

#define SPLATVOL_OPEN(name)                               \
  extern "C" int name(const char* path, int flags, ...) { \
    va_list rest;                                         \
    va_start(rest, flags);                                \
    const auto mode = va_arg(rest, mode_t);               \
    va_end(rest);                                         \
    return open_by(#name, path, flags, mode);             \
  }
SPLATVOL_OPEN(open)
SPLATVOL_OPEN(open64)

extern "C" ssize_t pwrite(int descriptor, const void* bytes, size_t count, off_t offset) {
  return pwrite_by("pwrite", descriptor, bytes, count, offset);
}
extern "C" ssize_t pwrite64(int descriptor, const void* bytes, size_t count, off64_t offset) {
  return pwrite_by("pwrite64", descriptor, bytes, count, offset);
}
extern "C" ssize_t write(int descriptor, const void* bytes, size_t count) {
  if (is_file(descriptor) && is_refused("write")) return -1;
  return next<ssize_t (*)(int, const void*, size_t)>("write")(descriptor, bytes, count);
}
extern "C" ssize_t writev(int descriptor, const iovec* parts, int count) {
  if (is_file(descriptor) && is_refused("writev")) return -1;
  return next<ssize_t (*)(int, const iovec*, int)>("writev")(descriptor, parts, count);
}

// A function of the system: its name, its parameters, their names, and whether it is declared noexcept.
#define SPLATVOL_CALL(name, parameters, arguments, exceptions) \
  extern "C" int name parameters exceptions {                  \
    if (is_refused(#name)) return -1;                          \
    return next<int(*) parameters>(#name) arguments;           \
  }
SPLATVOL_CALL(fsync, (int descriptor), (descriptor), )
SPLATVOL_CALL(fdatasync, (int descriptor), (descriptor), )
SPLATVOL_CALL(fallocate, (int descriptor, int mode, off_t begin, off_t bytes), (descriptor, mode, begin, bytes), )
SPLATVOL_CALL(fallocate64, (int descriptor, int mode, off64_t begin, off64_t bytes), (descriptor, mode, begin, bytes), )
SPLATVOL_CALL(ftruncate, (int descriptor, off_t bytes), (descriptor, bytes), noexcept)
SPLATVOL_CALL(ftruncate64, (int descriptor, off64_t bytes), (descriptor, bytes), noexcept)
SPLATVOL_CALL(fchmod, (int descriptor, mode_t mode), (descriptor, mode), noexcept)
SPLATVOL_CALL(chmod, (const char* path, mode_t mode), (path, mode), noexcept)
SPLATVOL_CALL(fchown, (int descriptor, uid_t owner, gid_t group), (descriptor, owner, group), noexcept)
SPLATVOL_CALL(mkdir, (const char* path, mode_t mode), (path, mode), noexcept)
SPLATVOL_CALL(unlink, (const char* path), (path), noexcept)
SPLATVOL_CALL(link, (const char* from, const char* to), (from, to), noexcept)
SPLATVOL_CALL(linkat, (int from, const char* path, int to, const char* name, int flags), (from, path, to, name, flags),
              noexcept)
SPLATVOL_CALL(rename, (const char* from, const char* to), (from, to), noexcept)
SPLATVOL_CALL(renameat, (int from, const char* path, int to, const char* name), (from, path, to, name), noexcept)
SPLATVOL_CALL(renameat2, (int from, const char* path, int to, const char* name, unsigned flags),
              (from, path, to, name, flags), noexcept)
SPLATVOL_CALL(flock, (int descriptor, int operation), (descriptor, operation), noexcept)
