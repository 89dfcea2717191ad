#include "builder/sources/process/allowed_calls.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/sched.h>
#include <linux/seccomp.h>
#include <sys/auxv.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <vector>

// Numbers of calls that headers older than the kernel lack. They are the same on all architectures.
#ifndef SYS_futex_waitv
#define SYS_futex_waitv 449
#endif

namespace splatvol {
namespace {

/// A program of the kernel's filter: the first rule that a call fits decides.
class Filter {
 public:
  /// Kills the process at calls of other architectures: their numbers mean other calls.
  Filter(std::uint32_t architecture, std::uint32_t end_of_numbers) {
    load(offsetof(seccomp_data, arch));
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, architecture, 1, 0));
    add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
    load(offsetof(seccomp_data, nr));
    add(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, end_of_numbers, 0, 1));
    add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS));
  }

  void allow(std::initializer_list<long> calls) {
    for (const long call : calls) {
      add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 1));
      add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
    }
  }

  void refuse(long call, std::uint32_t error) {
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 1));
    refuse_all(error);
  }

  /// Allows a call if an argument has one of the values in the bits of `mask`. Else it fails with EPERM.
  void allow_if(long call, unsigned argument, std::uint32_t mask, std::initializer_list<std::uint32_t> values) {
    const auto count = static_cast<std::uint8_t>(values.size());
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0,
                 static_cast<std::uint8_t>(2 * count + 3)));
    // The kernel takes these arguments as 32 bits, the lower ones.
    load_argument(argument, false);
    add(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask));
    for (const std::uint32_t value : values) {
      add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1));
      add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
    }
    refuse_all(EPERM);
  }

  /// Refuses a call if the lower half of an argument has one of the values.
  void refuse_if(long call, unsigned argument, std::initializer_list<std::uint32_t> values, std::uint32_t error) {
    const auto count = static_cast<std::uint8_t>(values.size());
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0,
                 static_cast<std::uint8_t>(2 * count + 2)));
    load_argument(argument, false);
    for (const std::uint32_t value : values) {
      add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1));
      refuse_all(error);
    }
    load(offsetof(seccomp_data, nr));
  }

  /// Refuses a call if an argument of 64 bits is not 0.
  void refuse_unless_zero(long call, unsigned argument, std::uint32_t error) {
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 7));
    for (const bool upper_half : {false, true}) {
      load_argument(argument, upper_half);
      add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 1, 0));
      refuse_all(error);
    }
    load(offsetof(seccomp_data, nr));
  }

  /// Allows a call if an argument is below a number of 64 bits. Else it fails with EPERM.
  void allow_below(long call, unsigned argument, std::uint64_t limit) {
    const auto upper = static_cast<std::uint32_t>(limit >> 32), lower = static_cast<std::uint32_t>(limit);
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 7));
    load_argument(argument, true);
    add(BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, upper, 4, 0));
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, upper, 0, 2));
    load_argument(argument, false);
    add(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, lower, 1, 0));
    add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
    refuse_all(EPERM);
  }

  /// Hands a call over to the process itself, by SIGSYS, if an argument has a value in the bits of `mask`.
  void hand_over_if(long call, unsigned argument, std::uint32_t mask, std::uint32_t value) {
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 5));
    load_argument(argument, false);
    add(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask));
    add(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1));
    add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP));
    load(offsetof(seccomp_data, nr));
  }

  void refuse_all(std::uint32_t error) { add(BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | error)); }

  /// For all threads. It sets no_new_privs for them, too.
  void install() {
    const sock_fprog program{static_cast<unsigned short>(rules_.size()), rules_.data()};
    ::syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &program);
  }

 private:
  void load_argument(unsigned argument, bool upper_half) {
    load(offsetof(seccomp_data, args) + argument * sizeof(std::uint64_t) + (upper_half ? sizeof(std::uint32_t) : 0));
  }
  void load(std::size_t offset) { add(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset))); }
  void add(sock_filter rule) { rules_.push_back(rule); }

  std::vector<sock_filter> rules_;
};

constexpr std::uint32_t all_bits = ~std::uint32_t{0};

void allow_files(Filter& filter) {
  constexpr std::uint32_t writing = O_ACCMODE | O_CREAT | O_TRUNC;
  filter.allow({SYS_read,       SYS_pread64, SYS_readv,  SYS_preadv,    SYS_lseek,     SYS_close,      SYS_fstat,
                SYS_newfstatat, SYS_statx,   SYS_statfs, SYS_fstatfs,   SYS_faccessat, SYS_readlinkat, SYS_getdents64,
                SYS_getcwd,     SYS_chdir,   SYS_fchdir, SYS_fadvise64, SYS_readahead, SYS_dup,        SYS_dup3});
#ifdef SYS_faccessat2
  filter.allow({SYS_faccessat2});
#endif
#ifdef SYS_open  // older calls, which newer architectures lack
  filter.allow({SYS_stat, SYS_lstat, SYS_access, SYS_readlink, SYS_getdents, SYS_dup2});
  filter.hand_over_if(SYS_open, 1, writing | O_NONBLOCK, O_RDONLY);
  filter.hand_over_if(SYS_open, 1, writing | unasked_open_flags, O_NONBLOCK);
  filter.allow_if(SYS_open, 1, writing, {O_RDONLY});
#endif
  // All others are answered, and noted, by opened_files.h.
  filter.hand_over_if(SYS_openat, 2, writing | O_NONBLOCK, O_RDONLY);
  filter.hand_over_if(SYS_openat, 2, writing | unasked_open_flags, O_NONBLOCK);
  filter.allow_if(SYS_openat, 2, writing, {O_RDONLY});
  // Other programs would wait for a lock. Libraries take this answer for a file system that has none, and go on.
  filter.refuse(SYS_flock, ENOSYS);
  filter.refuse_if(SYS_fcntl, 1, {F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW}, ENOSYS);
  // Not the commands that have the kernel send signals.
  filter.allow_if(SYS_fcntl, 1, all_bits, {F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_GETLK});
  // Not those that type into a terminal, for example.
  filter.allow_if(SYS_ioctl, 1, all_bits, {TCGETS, FIONREAD});
}

/// Returns an address below all that the main thread's stack can grow to, and above all other memory.
std::uint64_t floor_of_stack() {
  rlimit limit{};
  ::getrlimit(RLIMIT_STACK, &limit);
  const std::uint64_t top = ::getauxval(AT_EXECFN);
  return top - std::min<std::uint64_t>(limit.rlim_cur, top);
}

/// RLIMIT_DATA counts memory that is private, can be written and is no stack. So no other memory is made, and none
/// becomes read-only. The main thread's stack stays where it is: moved, it could grow past its limit.
void allow_private_memory(Filter& filter) {
  filter.allow_if(SYS_mmap, 3, MAP_TYPE | MAP_GROWSDOWN, {MAP_PRIVATE});
  filter.allow_if(SYS_mprotect, 2, PROT_WRITE, {PROT_WRITE});
  filter.allow_below(SYS_mremap, 0, floor_of_stack());
}

void allow_memory(Filter& filter) {
  filter.allow({SYS_munmap, SYS_madvise, SYS_brk, SYS_mincore, SYS_msync, SYS_mlock, SYS_munlock, SYS_get_mempolicy});
}

/// What the sanitizers take besides.
void allow_sanitizers(Filter& filter) { filter.allow({SYS_mmap, SYS_mprotect, SYS_mremap, SYS_pipe2}); }

/// Threads of this process, but no other process.
void allow_threads(Filter& filter) {
  filter.allow_if(SYS_clone, 0, CLONE_THREAD, {CLONE_THREAD});
  filter.allow({SYS_futex, SYS_futex_waitv, SYS_set_robust_list, SYS_get_robust_list, SYS_set_tid_address,
                SYS_membarrier, SYS_exit, SYS_exit_group, SYS_sched_yield, SYS_sched_getaffinity,
                SYS_sched_getscheduler, SYS_sched_getparam, SYS_sched_get_priority_min, SYS_sched_get_priority_max,
                SYS_getcpu});
#ifdef SYS_rseq
  filter.allow({SYS_rseq});
#endif
#ifdef SYS_arch_prctl
  filter.allow({SYS_arch_prctl});
#endif
  const auto own = static_cast<std::uint32_t>(::getpid());
  filter.allow_if(SYS_sched_setaffinity, 0, all_bits, {0});
  filter.allow_if(SYS_prctl, 0, all_bits, {PR_SET_NAME, PR_GET_NAME, PR_GET_DUMPABLE, PR_GET_SECCOMP});
  filter.allow_if(SYS_tgkill, 0, all_bits, {own});  // for abort()
}

void allow_the_rest(Filter& filter) {
  // The socket to the other process is connected, and there is no call that makes another.
  filter.allow({SYS_recvfrom, SYS_sendto, SYS_write, SYS_writev, SYS_ppoll, SYS_pselect6, SYS_shutdown});
#ifdef SYS_poll
  filter.allow({SYS_poll, SYS_select, SYS_time});
#endif
  filter.allow({SYS_getpid,        SYS_gettid,         SYS_getppid,      SYS_getuid,        SYS_geteuid,
                SYS_getgid,        SYS_getegid,        SYS_uname,        SYS_sysinfo,       SYS_getrandom,
                SYS_clock_gettime, SYS_clock_getres,   SYS_gettimeofday, SYS_nanosleep,     SYS_clock_nanosleep,
                SYS_times,         SYS_getrusage,      SYS_getrlimit,    SYS_getpriority,   SYS_restart_syscall,
                SYS_rt_sigaction,  SYS_rt_sigprocmask, SYS_rt_sigreturn, SYS_rt_sigpending, SYS_sigaltstack});
  filter.refuse_unless_zero(SYS_prlimit64, 2, EPERM);  // new limits
  filter.allow_if(SYS_prlimit64, 0, all_bits, {0});    // of this process
}

}  // namespace

void allow_reading_only(bool limits_memory) {
#if defined(__x86_64__)
  constexpr std::uint32_t architecture = AUDIT_ARCH_X86_64, end_of_numbers = 0x40000000;  // the same calls again
#elif defined(__aarch64__)
  constexpr std::uint32_t architecture = AUDIT_ARCH_AARCH64, end_of_numbers = ~std::uint32_t{0};
#else
  return;
#endif
  Filter filter(architecture, end_of_numbers);
  allow_files(filter);
  limits_memory ? allow_private_memory(filter) : allow_sanitizers(filter);
  allow_memory(filter);
  allow_threads(filter);
  allow_the_rest(filter);
  filter.refuse(SYS_execve, EPERM);
  filter.refuse(SYS_execveat, EPERM);
  // The C library then uses an older call, and programs do without: so newer libraries run, too.
  filter.refuse_all(ENOSYS);
  filter.install();
}

}  // namespace splatvol
