#include "builder/sources/process/opened_files.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <string_view>
#include <utility>

#include "builder/sources/process/allowed_calls.h"

namespace splatvol {
namespace {

/// A name that a handler of signals may write, in any thread.
class NotedName {
 public:
  /// Keeps the first one.
  void note(const char* name) {
    State empty = State::empty;
    if (!state_.compare_exchange_strong(empty, State::written)) return;
    std::strncpy(name_.data(), name, name_.size() - 1);
    state_ = State::noted;
  }

  std::string take() {
    if (state_ != State::noted) return {};
    std::string name(name_.data());
    state_ = State::empty;
    return name;
  }

 private:
  enum class State { empty, written, noted };
  std::atomic<State> state_ = State::empty;
  std::array<char, 4096> name_{};
};

NotedName refused;

/// Names of files that a handler of signals may add, in any thread: it takes no memory from the C library. Locked for
/// the time of a copy, and never while something is opened.
class NameList {
 public:
  /// `folder`: what a relative name is relative to, as for openat.
  void add(bool is_there, int folder, const char* name) {
    std::array<char, 4096> place;
    const std::string_view of_folder = folder == AT_FDCWD || name[0] == '/' ? "" : path_of(folder, place);
    const std::string_view own(name);
    const std::size_t bytes = 1 + of_folder.size() + 1 + own.size() + 1;
    lock();
    if (reserve(bytes)) {
      names_[size_++] = is_there ? opened : missing;
      append(of_folder);
      if (!of_folder.empty()) append("/");
      append(own);
      names_[size_++] = '\0';
    } else {
      are_all_ = false;
    }
    unlock();
  }

  OpenedFiles take() {
    lock();
    char* const names = std::exchange(names_, nullptr);
    const std::size_t size = std::exchange(size_, 0), room = std::exchange(room_, 0);
    OpenedFiles files;
    files.are_all = std::exchange(are_all_, true);
    unlock();
    for (std::size_t at = 0; at < size;) {
      const std::string_view name(names + at + 1);
      (names[at] == opened ? files.opened : files.missing).emplace_back(name);
      at += 1 + name.size() + 1;
    }
    if (names) ::munmap(names, room);
    return files;
  }

 private:
  static constexpr char opened = '+', missing = '-';

  /// Returns the path of an open folder, in `place`.
  static std::string_view path_of(int folder, std::array<char, 4096>& place) {
    constexpr std::string_view open_files = "/proc/self/fd/";
    std::array<char, 32> link{};
    open_files.copy(link.data(), open_files.size());
    std::to_chars(link.data() + open_files.size(), link.data() + link.size() - 1, folder);
    const ssize_t bytes = ::readlink(link.data(), place.data(), place.size());
    return {place.data(), static_cast<std::size_t>(bytes > 0 ? bytes : 0)};
  }

  bool reserve(std::size_t bytes) {
    if (room_ - size_ >= bytes) return true;
    const std::size_t room = (room_ + bytes) * 2 + (std::size_t{1} << 16);
    void* const larger = ::mmap(nullptr, room, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (larger == MAP_FAILED) return false;
    if (names_) {
      std::memcpy(larger, names_, size_);
      ::munmap(names_, room_);
    }
    names_ = static_cast<char*>(larger);
    room_ = room;
    return true;
  }

  void append(std::string_view text) { size_ += text.copy(names_ + size_, text.size()); }

  void lock() {
    while (locked_.test_and_set(std::memory_order_acquire)) {
    }
  }
  void unlock() { locked_.clear(std::memory_order_release); }

  std::atomic_flag locked_;
  char* names_ = nullptr;  // each: whether it was there, the name, a zero
  std::size_t size_ = 0, room_ = 0;
  bool are_all_ = true;
};

NameList names;

bool is_special(const struct stat& status) { return !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode); }

/// This open is not handed over.
long open_now(int folder, const char* path, int flags, mode_t mode) {
  const long descriptor = ::syscall(SYS_openat, folder, path, flags | unasked_open_flags, mode);
  const long result = descriptor < 0 ? -errno : descriptor;
  if (result >= 0 || result == -ENOENT) names.add(result >= 0, folder, path);
  return result;
}

/// Opens a file as openat does. Returns its descriptor, or an error below 0 as the kernel does.
long open_usual(int folder, const char* path, int flags, mode_t mode) {
  // Whoever asks not to wait looks at the file by itself.
  if (flags & O_NONBLOCK) return open_now(folder, path, flags, mode);
  struct stat status {};
  bool special = ::fstatat(folder, path, &status, 0) == 0 && is_special(status);
  if (!special) {
    // The file may be another now.
    const long descriptor = open_now(folder, path, flags, mode);
    if (descriptor < 0) return descriptor;
    special = ::fstat(static_cast<int>(descriptor), &status) == 0 && is_special(status);
    if (!special) return descriptor;
    ::close(static_cast<int>(descriptor));
  }
  refused.note(path);
  return -ENXIO;
}

/// Replaces a call that was handed over: puts its result where the program expects it.
void answer(int, siginfo_t* info, void* context) {
  const int error = errno;
  mcontext_t& registers = static_cast<ucontext_t*>(context)->uc_mcontext;
#if defined(__x86_64__)
  const auto argument = [&](int number) { return registers.gregs[number]; };
  const bool has_folder = info->si_syscall == SYS_openat;
  const int first = has_folder ? static_cast<int>(argument(REG_RDI)) : AT_FDCWD;
  const auto path = argument(has_folder ? REG_RSI : REG_RDI), flags = argument(has_folder ? REG_RDX : REG_RSI),
             mode = argument(has_folder ? REG_R10 : REG_RDX);
  registers.gregs[REG_RAX] =
      open_usual(first, reinterpret_cast<const char*>(path), static_cast<int>(flags), static_cast<mode_t>(mode));
#elif defined(__aarch64__)
  static_cast<void>(info);
  const auto* arguments = registers.regs;
  registers.regs[0] = static_cast<unsigned long long>(
      open_usual(static_cast<int>(arguments[0]), reinterpret_cast<const char*>(arguments[1]),
                 static_cast<int>(arguments[2]), static_cast<mode_t>(arguments[3])));
#endif
  errno = error;
}

}  // namespace

void answer_opens() {
  struct sigaction action {};
  action.sa_sigaction = answer;
  action.sa_flags = SA_SIGINFO | SA_RESTART;
  ::sigaction(SIGSYS, &action, nullptr);
  // The program that started this one may have blocked it; the kernel would end the process then.
  sigset_t handed_over{};
  ::sigemptyset(&handed_over);
  ::sigaddset(&handed_over, SIGSYS);
  ::pthread_sigmask(SIG_UNBLOCK, &handed_over, nullptr);
}

OpenedFiles take_opened_files() { return names.take(); }

std::string take_refused_file() { return refused.take(); }

}  // namespace splatvol
