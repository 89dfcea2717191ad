#include "builder/sources/process/opened_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>

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

bool is_special(const struct stat& status) { return !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode); }

/// Opens a file as openat does. Returns its descriptor, or an error below 0 as the kernel does.
long open_usual(int folder, const char* path, int flags, mode_t mode) {
  struct stat status {};
  bool special = ::fstatat(folder, path, &status, 0) == 0 && is_special(status);
  if (!special) {
    // The file may be another now. This call is not handed over.
    const long descriptor = ::syscall(SYS_openat, folder, path, flags | O_NONBLOCK, mode);
    if (descriptor < 0) return -errno;
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

std::string take_refused_file() { return refused.take(); }

}  // namespace splatvol
