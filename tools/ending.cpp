#include "tools/ending.h"

#include <poll.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <system_error>
#include <thread>

#include "base/temporary_names.h"

namespace splatvol {
namespace {

// All whose default action ends a process and that can be caught; clean_up_at_signals adds the real-time ones.
constexpr std::array ending_signals = {SIGHUP,
                                       SIGINT,
                                       SIGQUIT,
                                       SIGILL,
                                       SIGTRAP,
                                       SIGABRT,
                                       SIGBUS,
                                       SIGFPE,
                                       SIGUSR1,
                                       SIGSEGV,
                                       SIGUSR2,
                                       SIGPIPE,
                                       SIGALRM,
                                       SIGTERM,
                                       SIGXCPU,
                                       SIGXFSZ,
                                       SIGPROF,
                                       SIGSYS,
                                       SIGPOLL,
                                       SIGVTALRM
#ifdef SIGSTKFLT
                                       ,
                                       SIGSTKFLT
#endif
#ifdef SIGPWR
                                       ,
                                       SIGPWR
#endif
};

pid_t owner = 0;  // of the temporary files: not a child that has yet to start its program
std::atomic<const char*> last_line = nullptr;

void clean_up(int signal) {
  const int error = errno;
  if (::getpid() == owner) {
    remove_temporaries();
    const char* const line = last_line;
    if (signal == SIGINT && line) (void)!::write(STDOUT_FILENO, line, std::strlen(line));
  }
  errno = error;
  ::raise(signal);  // its action is the default one again
}

void clean_up_at(int signal) {
  struct sigaction before {};
  if (::sigaction(signal, nullptr, &before) != 0 || before.sa_handler != SIG_DFL) return;
  struct sigaction action {};
  action.sa_handler = clean_up;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(signal, &action, nullptr);
}

// What an exception says that nobody catches; nothing if it is a fault of the program.
const char* lack(const std::exception_ptr& exception) noexcept {
  try {
    if (exception) std::rethrow_exception(exception);
  } catch (const std::bad_alloc&) {
    return "not enough memory";
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::resource_unavailable_try_again) return "the system allows no more threads";
  } catch (...) {
    return nullptr;
  }
  return nullptr;
}

// Libraries allocate in threads, destructors and functions that may not throw.
[[noreturn]] void end_at_lack() {
  if (const char* what = lack(std::current_exception())) {
    remove_temporaries();
    say(::program_invocation_short_name, what);
    ::_exit(1);
  }
  std::abort();
}

// Before all libraries prepare themselves: some start threads (OpenVDB's logger). And before `main`, which allocates to
// describe its options.
void catch_lack() { std::set_terminate(end_at_lack); }
[[gnu::section(".preinit_array"), gnu::used]] void (*const before_libraries)() = catch_lack;

}  // namespace

void clean_up_at_signals() {
  owner = ::getpid();
  for (const int signal : ending_signals) clean_up_at(signal);
  for (int signal = SIGRTMIN; signal <= SIGRTMAX; ++signal) clean_up_at(signal);
}

void say_when_interrupted(const char* line) { last_line = line; }

// A handle on the parent tells of its end. PR_SET_PDEATHSIG would tell of the end of one of its threads, if that one
// started this process; it serves older kernels.
void end_with_parent() {
  const pid_t parent = ::getppid();
  const int handle = static_cast<int>(::syscall(SYS_pidfd_open, parent, 0));
  if (handle < 0) ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) std::raise(SIGTERM);  // it has ended meanwhile
  if (handle < 0) return;
  std::thread([handle] {
    pollfd of_parent{handle, POLLIN, 0};
    while (::poll(&of_parent, 1, -1) < 0) {
    }
    ::kill(::getpid(), SIGTERM);
  }).detach();
}

void say(std::string_view name, std::string_view message) noexcept {
  const auto part = [](std::string_view text) { return iovec{const_cast<char*>(text.data()), text.size()}; };
  const std::array line = {part(name), part(": "), part(message), part("\n")};
  (void)!::writev(STDERR_FILENO, line.data(), line.size());
}

}  // namespace splatvol
