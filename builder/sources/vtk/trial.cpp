#include "builder/sources/vtk/trial.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <system_error>

namespace splatvol {
namespace {

[[noreturn]] void run_child(unsigned seconds, const std::function<void()>& call) {
  const int nothing = ::open("/dev/null", O_RDWR);
  ::dup2(nothing, STDOUT_FILENO);
  ::dup2(nothing, STDERR_FILENO);
  const rlimit no_core = {0, 0}, time = {seconds, seconds};
  ::setrlimit(RLIMIT_CORE, &no_core);
  ::setrlimit(RLIMIT_CPU, &time);
  for (const int signal : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, SIG_DFL);
  try {
    call();
  } catch (...) {
    // The real run will report it.
  }
  ::_exit(0);
}

}  // namespace

Status try_in_child(const std::string& path, unsigned seconds, const std::function<void()>& call) {
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child < 0) return fail(ErrorCode::io, "fork: {}", std::system_category().message(errno));
  if (child == 0) run_child(seconds, call);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return fail(ErrorCode::io, "waitpid: {}", std::system_category().message(errno));
  if (!WIFSIGNALED(status)) return {};
  const char* what = WTERMSIG(status) == SIGKILL || WTERMSIG(status) == SIGXCPU ? "does not get to an end" : "crashes";
  return fail(ErrorCode::invalid_data, "{}: VTK's reader {} on it: damaged, or a file that it names is", path, what);
}

}  // namespace splatvol
