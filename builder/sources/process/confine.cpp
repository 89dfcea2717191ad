#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <thread>

#include "builder/sources/process/serve_sources.h"

namespace splatvol {
namespace {

/// Sanitizers reserve address space that the limit would count.
#if defined(__SANITIZE_ADDRESS__)
#define SPLATVOL_UNLIMITED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SPLATVOL_UNLIMITED
#endif
#endif

void limit_memory([[maybe_unused]] std::uint64_t bytes) {
#ifndef SPLATVOL_UNLIMITED
  rlimit limit{};
  ::getrlimit(RLIMIT_DATA, &limit);
  limit.rlim_cur = bytes < limit.rlim_max ? bytes : limit.rlim_max;
  ::setrlimit(RLIMIT_DATA, &limit);
#endif
}

void forbid_writing() {
  landlock_ruleset_attr rules{};
  rules.handled_access_fs = LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                            LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR |
                            LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK |
                            LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM;
  const long ruleset = ::syscall(SYS_landlock_create_ruleset, &rules, sizeof(rules), 0);
  if (ruleset < 0) return;
  ::syscall(SYS_landlock_restrict_self, static_cast<int>(ruleset), 0);
  ::close(static_cast<int>(ruleset));
}

/// These system calls fail with EPERM: reading files needs none of them.
void forbid_calls() {
  constexpr std::array<std::uint32_t, 16> forbidden = {
      SYS_socket, SYS_connect, SYS_execve, SYS_execveat, SYS_ptrace, SYS_process_vm_readv, SYS_process_vm_writev,
      SYS_kill,   SYS_tkill,   SYS_bind,   SYS_truncate, SYS_linkat, SYS_io_uring_setup,   SYS_bpf,
      SYS_keyctl, SYS_mount};
  std::array<sock_filter, 2 * forbidden.size() + 7> filter{};
  std::size_t size = 0;
#if defined(__x86_64__)
  constexpr std::uint32_t architecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
  constexpr std::uint32_t architecture = AUDIT_ARCH_AARCH64;
#else
  return;
#endif
  const auto load = [&](std::size_t offset) {
    filter[size++] = BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset));
  };
  load(offsetof(seccomp_data, arch));
  filter[size++] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, architecture, 1, 0);
  filter[size++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS);
  load(offsetof(seccomp_data, nr));
#if defined(__x86_64__)
  constexpr std::uint32_t other_numbering = 0x40000000;  // of the same calls
  filter[size++] = BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, other_numbering, 0, 1);
  filter[size++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS);
#endif
  for (const std::uint32_t call : forbidden) {
    filter[size++] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, call, 0, 1);
    filter[size++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | 1);
  }
  filter[size++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
  const sock_fprog program{static_cast<unsigned short>(size), filter.data()};
  ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
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
  const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) ::dup2(nothing, stream);
  const rlimit no_core{0, 0};
  ::setrlimit(RLIMIT_CORE, &no_core);
  limit_memory(limits.memory);
  end_with(socket);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  forbid_writing();
  forbid_calls();
}

}  // namespace splatvol
