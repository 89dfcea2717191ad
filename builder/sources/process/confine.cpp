#include <fcntl.h>
#include <linux/landlock.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <thread>

#include "builder/sources/process/allowed_calls.h"
#include "builder/sources/process/opened_files.h"
#include "builder/sources/process/serve_sources.h"

namespace splatvol {
namespace {

/// Sanitizers reserve address space that the limits would count.
#if defined(__SANITIZE_ADDRESS__)
#define SPLATVOL_UNLIMITED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SPLATVOL_UNLIMITED
#endif
#endif
#ifdef SPLATVOL_UNLIMITED
constexpr bool limits_memory = false;
#else
constexpr bool limits_memory = true;
#endif

/// As landlock_ruleset_attr, whose header may be older than the kernel. A kernel takes zeros behind what it knows.
struct LandlockRules {
  std::uint64_t files, ports, scopes;
};

/// Returns the rights that a version of Landlock knows, besides those to read.
LandlockRules rights_of(long version) {
  constexpr std::uint64_t refer = 1u << 13, truncate = 1u << 14, control_devices = 1u << 15;
  LandlockRules rules{LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                          LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR |
                          LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO |
                          LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM,
                      0, 0};
  if (version >= 2) rules.files |= refer;
  if (version >= 3) rules.files |= truncate;
  if (version >= 4) rules.ports = 3;  // bind and connect
  if (version >= 5) rules.files |= control_devices;
  if (version >= 6) rules.scopes = 3;  // abstract sockets and signals of others
  return rules;
}

/// For this thread and those that it starts.
void forbid_writing() {
  const long version = ::syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (version < 1) return;
  const LandlockRules rules = rights_of(version);
  const long ruleset = ::syscall(SYS_landlock_create_ruleset, &rules, sizeof(rules), 0);
  if (ruleset < 0) return;
  ::syscall(SYS_landlock_restrict_self, static_cast<int>(ruleset), 0);
  ::close(static_cast<int>(ruleset));
}

/// What the caller, or its caller, left open could be written to.
void close_all_but(int socket) {
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::dup2(nothing, stream) < 0) ::close(stream);
  const auto first = static_cast<unsigned>(STDERR_FILENO) + 1, kept = static_cast<unsigned>(socket);
  if (kept > first) ::syscall(SYS_close_range, first, kept - 1, 0);
  ::syscall(SYS_close_range, kept + 1, ~0u, 0);
}

void set_limit(decltype(RLIMIT_CORE) resource, std::uint64_t most) {
  rlimit limit{};
  ::getrlimit(resource, &limit);
  limit.rlim_max = std::min<std::uint64_t>(limit.rlim_max, most);
  limit.rlim_cur = std::min(limit.rlim_cur, limit.rlim_max);
  ::setrlimit(resource, &limit);
}

/// Besides what can be written, memory takes address space, and the kernel's tables grow with it.
void limit_memory(std::uint64_t most) {
  constexpr std::uint64_t stack = std::uint64_t{64} << 20;
  constexpr std::uint64_t reserved = std::uint64_t{64} << 30;  // by pools and stacks of threads
  set_limit(RLIMIT_DATA, most);
  set_limit(RLIMIT_STACK, stack);
  set_limit(RLIMIT_AS, most < ~reserved ? most + reserved : most);
}

/// A reader in an endless loop does not see that nobody waits for it.
void end_with(int socket) {
  std::thread([socket] {
    pollfd other_side{socket, POLLRDHUP, 0};
    while (::poll(&other_side, 1, -1) < 0) {
    }
    ::_exit(1);
  }).detach();
}

}  // namespace

void confine_reader(int socket, const ReaderLimits& limits) {
  close_all_but(socket);
  set_limit(RLIMIT_CORE, 0);
  set_limit(RLIMIT_FSIZE, 0);
  if (limits_memory) limit_memory(limits.memory);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  forbid_writing();
  answer_opens();
  allow_reading_only(limits_memory);
  // Last: a thread that runs before would be free.
  end_with(socket);
}

}  // namespace splatvol
