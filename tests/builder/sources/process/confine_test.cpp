// What a reader process that a file has taken over may try.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <linux/sched.h>
#include <sys/auxv.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "builder/opening/open_source.h"
#include "builder/sources/process/serve_sources.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

constexpr std::uint64_t plenty = std::uint64_t{1} << 30;

/// Something that a reader must not be able to do.
struct Escape {
  const char* name;
  std::function<bool()> succeeds;
};

template <class... Arguments>
bool call(long number, Arguments... arguments) {
  return ::syscall(number, arguments...) >= 0;
}

/// In the child, a fork ends at once.
bool forks(long result) {
  if (result == 0) ::_exit(0);
  return result > 0;
}

std::vector<Escape> escapes_to_files(const std::string& folder, const std::string& victim, int inherited) {
  const char* const file = victim.c_str();
  const auto opens = [=](int flags) { return ::open(file, flags, 0600) >= 0; };
  const auto read_only = [=] { return ::open(file, O_RDONLY | O_CLOEXEC); };
  const std::string other = folder + "escaped";
  return {
      {"create", [=] { return ::open(other.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600) >= 0; }},
      {"creat", [=] { return ::creat(other.c_str(), 0600) >= 0; }},
      {"unnamed", [=] { return ::open(folder.c_str(), O_RDWR | O_TMPFILE | O_CLOEXEC, 0600) >= 0; }},
      {"write", [=] { return opens(O_WRONLY); }},
      {"read and write", [=] { return opens(O_RDWR); }},
      {"no access", [=] { return opens(O_ACCMODE); }},
      {"empty", [=] { return opens(O_RDONLY | O_TRUNC); }},
      {"truncate", [=] { return ::truncate(file, 0) == 0; }},
      {"chmod", [=] { return ::chmod(file, 0777) == 0; }},
      {"fchmod", [=] { return ::fchmod(read_only(), 0777) == 0; }},
      {"fchmodat", [=] { return ::fchmodat(AT_FDCWD, file, 0777, 0) == 0; }},
      {"chown", [=] { return ::chown(file, ::getuid(), ::getgid()) == 0; }},
      {"fchown", [=] { return ::fchown(read_only(), ::getuid(), ::getgid()) == 0; }},
      {"fchownat", [=] { return ::fchownat(AT_FDCWD, file, ::getuid(), ::getgid(), 0) == 0; }},
      {"setxattr", [=] { return call(SYS_setxattr, file, "user.a", "b", 1, 0); }},
      {"fsetxattr", [=] { return call(SYS_fsetxattr, read_only(), "user.a", "b", 1, 0); }},
      {"utimensat", [=] { return ::utimensat(AT_FDCWD, file, nullptr, 0) == 0; }},
      {"rename", [=] { return std::rename(file, other.c_str()) == 0; }},
      {"unlink", [=] { return ::unlink(file) == 0; }},
      {"link", [=] { return ::link(file, other.c_str()) == 0; }},
      {"symlink", [=] { return ::symlink(file, other.c_str()) == 0; }},
      {"mkdir", [=] { return ::mkdir(other.c_str(), 0700) == 0; }},
      {"mkfifo", [=] { return ::mkfifo(other.c_str(), 0600) == 0; }},
      {"descriptor that is left open", [=] { return ::write(inherited, "x", 1) > 0; }},
      {"descriptor that is left open, its length", [=] { return ::ftruncate(inherited, 0) == 0; }},
      {"openat2", [=] { return call(437, AT_FDCWD, file, std::array<std::uint64_t, 3>{O_RDWR}.data(), 24); }},
  };
}

std::vector<Escape> escapes_to_processes() {
  const pid_t parent = ::getppid();
  static char memory[8];
  static iovec here{memory, 8}, there{memory, 8};
  static siginfo_t signal{};
  return {
      {"kill", [=] { return ::kill(parent, 0) == 0; }},
      {"tkill", [=] { return call(SYS_tkill, parent, 0); }},
      {"tgkill", [=] { return call(SYS_tgkill, parent, parent, 0); }},
      {"rt_sigqueueinfo", [=] { return call(SYS_rt_sigqueueinfo, parent, 0, &signal); }},
      {"rt_tgsigqueueinfo", [=] { return call(SYS_rt_tgsigqueueinfo, parent, parent, 0, &signal); }},
      {"pidfd_open", [=] { return call(SYS_pidfd_open, parent, 0); }},
      {"fcntl", [=] { return ::fcntl(0, F_SETOWN, parent) == 0; }},
      {"ptrace", [=] { return ::ptrace(PTRACE_SEIZE, parent, 0, 0) == 0; }},
      {"process_vm_readv", [=] { return call(SYS_process_vm_readv, parent, &here, 1, &there, 1, 0); }},
      {"process_vm_writev", [=] { return call(SYS_process_vm_writev, parent, &here, 1, &there, 1, 0); }},
      {"prlimit",
       [=] {
         rlimit limit{};
         return call(SYS_prlimit64, parent, RLIMIT_NOFILE, nullptr, &limit);
       }},
      {"setpriority", [=] { return ::setpriority(PRIO_PROCESS, static_cast<id_t>(parent), 1) == 0; }},
      {"sched_setaffinity", [=] { return call(SYS_sched_setaffinity, parent, 8, memory); }},
      {"more memory",
       [=] {
         const rlimit limit{2 * plenty, 2 * plenty};
         return ::setrlimit(RLIMIT_DATA, &limit) == 0;
       }},
  };
}

/// A lock would make other programs wait. Libraries go on only where the answer is that there are no locks.
bool locks(int result) { return result == 0 || errno != ENOSYS; }

std::vector<Escape> escapes_to_locks(const std::string& victim) {
  const int file = ::open(victim.c_str(), O_RDONLY | O_CLOEXEC);
  const auto locks_by = [=](int command, short type) {
    struct flock lock {};
    lock.l_type = type;
    return locks(::fcntl(file, command, &lock));
  };
  return {
      {"flock", [=] { return locks(::flock(file, LOCK_EX | LOCK_NB)); }},
      {"shared flock", [=] { return locks(::flock(file, LOCK_SH | LOCK_NB)); }},
      {"F_SETLK", [=] { return locks_by(F_SETLK, F_RDLCK); }},
      {"F_SETLKW", [=] { return locks_by(F_SETLKW, F_RDLCK); }},
      {"F_OFD_SETLK", [=] { return locks_by(F_OFD_SETLK, F_RDLCK); }},
      {"F_OFD_SETLKW", [=] { return locks_by(F_OFD_SETLKW, F_RDLCK); }},
      {"lease", [=] { return ::fcntl(file, F_SETLEASE, F_RDLCK) == 0; }},
  };
}

constexpr std::size_t block = std::size_t{4} << 20;  // bytes

/// Takes a block, and touches it. Returns null if there is none.
char* take(int protection, int flags, int file = -1) {
  void* const memory = ::mmap(nullptr, block, protection, flags, file, 0);
  if (memory == MAP_FAILED) return nullptr;
  if ((protection & PROT_WRITE) != 0) std::memset(memory, 1, block);
  return static_cast<char*>(memory);
}

bool makes_uncounted(int protection) {
  char* const memory = take(PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS);
  return memory != nullptr && ::mprotect(memory, block, protection) == 0;
}

/// A page at the top of the main thread's stack.
void* page_of_stack() { return reinterpret_cast<void*>(::getauxval(AT_EXECFN) & ~4095ul); }

/// Memory that a limit on data does not count.
std::vector<Escape> escapes_to_memory(const std::string& victim) {
  constexpr int both = PROT_READ | PROT_WRITE, nowhere = MAP_ANONYMOUS;
  const int file = ::open(victim.c_str(), O_RDONLY | O_CLOEXEC);
  return {
      {"shared memory", [=] { return take(both, MAP_SHARED | nowhere) != nullptr; }},
      {"validated shared memory", [=] { return take(both, MAP_SHARED_VALIDATE | nowhere) != nullptr; }},
      {"droppable memory", [=] { return take(both, 0x08 | nowhere) != nullptr; }},
      {"shared memory of a file", [=] { return take(PROT_READ, MAP_SHARED, file) != nullptr; }},
      {"a stack", [=] { return take(both, MAP_PRIVATE | MAP_GROWSDOWN | nowhere) != nullptr; }},
      {"a larger stack", [] { return ::mremap(page_of_stack(), 4096, block, MREMAP_MAYMOVE) != MAP_FAILED; }},
      {"memory that is then read-only", [] { return makes_uncounted(PROT_READ); }},
      {"memory that is then without access", [] { return makes_uncounted(PROT_NONE); }},
      {"memory that is then code", [] { return makes_uncounted(PROT_READ | PROT_EXEC); }},
      // Pages that are only read share one page of zeros, but each has an entry in the kernel's tables.
      {"address space",
       [] {
         constexpr std::size_t much = std::size_t{128} << 30;
         return ::mmap(nullptr, much, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0) != MAP_FAILED;
       }},
      {"shmget", [] { return call(SYS_shmget, IPC_PRIVATE, block, 0600); }},
      {"remap_file_pages", [] { return call(SYS_remap_file_pages, page_of_stack(), 4096, 0, 0, 0); }},
      {"memfd_secret", [] { return call(447, 0); }},
      {"pkey_mprotect", [] { return call(SYS_pkey_mprotect, page_of_stack(), 4096, PROT_READ, -1); }},
      {"pipe",
       [] {
         int ends[2];
         return ::pipe2(ends, O_CLOEXEC) == 0;
       }},
      {"limit",
       [] {
         rlimit limit{};
         return ::getrlimit(RLIMIT_NOFILE, &limit) == 0 && ::setrlimit(RLIMIT_NOFILE, &limit) == 0;
       }},
  };
}

/// What readers need besides, and do not get.
std::string missing_memory(const std::string& victim) {
  std::string names;
  const int file = ::open(victim.c_str(), O_RDONLY | O_CLOEXEC);
  if (take(PROT_READ, MAP_PRIVATE, file) == nullptr) names += "no file in memory; ";
  char* const memory = take(PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS);
  if (memory == nullptr || ::mremap(memory, block, 2 * block, MREMAP_MAYMOVE) == MAP_FAILED) names += "no growth; ";
  void* const reserved = ::mmap(nullptr, block, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (::mprotect(reserved, block, PROT_READ | PROT_WRITE) != 0) names += "no reserved memory; ";
  std::thread([] {}).join();
  return names;
}

std::vector<Escape> escapes_to_programs() {
  static char* const nothing[] = {nullptr};
  return {
      {"fork", [] { return forks(::fork()); }},
      {"clone", [] { return forks(::syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0)); }},
      {"clone3",
       [] {
         clone_args arguments{};
         arguments.exit_signal = SIGCHLD;
         return forks(::syscall(SYS_clone3, &arguments, sizeof(arguments)));
       }},
      {"execve", [] { return ::execve("/bin/true", nothing, nothing) == 0 || errno != EPERM; }},
      {"execveat", [] { return call(SYS_execveat, AT_FDCWD, "/bin/true", nothing, nothing, 0) || errno != EPERM; }},
      {"memfd_create", [] { return call(SYS_memfd_create, "a", 0); }},
      {"socket", [] { return ::socket(AF_INET, SOCK_STREAM, 0) >= 0; }},
      {"local socket", [] { return ::socket(AF_UNIX, SOCK_DGRAM, 0) >= 0; }},
      {"socketpair",
       [] {
         int pair[2];
         return ::socketpair(AF_UNIX, SOCK_DGRAM, 0, pair) == 0;
       }},
      {"io_uring",
       [] {
         std::array<std::uint64_t, 32> parameters{};
         return call(SYS_io_uring_setup, 1, parameters.data());
       }},
      {"unshare", [] { return call(SYS_unshare, CLONE_NEWUSER); }},
      {"keyctl", [] { return call(SYS_keyctl, 0, -3, 1); }},
      {"typing",
       [] {
         char letter = 'x';
         return ::ioctl(0, TIOCSTI, &letter) == 0 || errno != EPERM;
       }},
  };
}

/// Returns the names of what succeeds, and of what a reader needs and does not get.
std::string try_all(const std::vector<Escape>& escapes, const std::string& victim) {
  std::string names;
  for (const Escape& escape : escapes)
    if (escape.succeeds()) names += std::string(escape.name) + "; ";
  char text[9] = {};
  const int file = ::open(victim.c_str(), O_RDONLY | O_CLOEXEC);
  if (::read(file, text, 8) != 8 || std::string(text) != "precious") names += "cannot read; ";
  return names + missing_memory(victim);
}

class ConfineTest : public FolderTest {
 protected:
  enum class From { main, new_thread, old_thread };

  /// Tries everything in a reader process. Returns what succeeded.
  std::string escaped(From from) const {
    void* const shared = ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    std::array<int, 2> sockets{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()), 0);
    const std::string victim = write("victim", "precious");
    const pid_t child = ::fork();
    if (child == 0) {
      const int inherited = ::open(victim.c_str(), O_RDWR);
      const std::string names = confined(from, sockets[0], all_escapes(victim, inherited), victim);
      names.copy(static_cast<char*>(shared), 4095);
      ::_exit(0);
    }
    int status = -1;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
    ::close(sockets[0]);
    ::close(sockets[1]);
    std::string names(static_cast<const char*>(shared));
    ::munmap(shared, 4096);
    return names;
  }

 private:
  std::vector<Escape> all_escapes(const std::string& victim, int inherited) const {
    std::vector<Escape> all = escapes_to_files(folder_, victim, inherited);
    for (const auto& more :
         {escapes_to_processes(), escapes_to_programs(), escapes_to_locks(victim), escapes_to_memory(victim)})
      all.insert(all.end(), more.begin(), more.end());
    return all;
  }

  static std::string confined(From from, int socket, const std::vector<Escape>& escapes, const std::string& victim) {
    std::atomic<bool> is_confined = false;
    std::string names;
    const auto try_when_confined = [&] {
      is_confined.wait(false);
      names = try_all(escapes, victim);
    };
    std::thread old_thread;  // as a library may start one before main()
    if (from == From::old_thread) old_thread = std::thread(try_when_confined);
    confine_reader(socket, {plenty});
    is_confined = true;
    is_confined.notify_all();
    if (from == From::old_thread) old_thread.join();
    if (from == From::main) try_when_confined();
    if (from == From::new_thread) std::thread(try_when_confined).join();
    return names;
  }
};

TEST_F(ConfineTest, NoThreadCanDoMoreThanRead) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers need these calls at the end";
  for (const From from : {From::main, From::new_thread, From::old_thread}) {
    EXPECT_EQ(escaped(from), "") << static_cast<int>(from);
    std::ifstream victim(path("victim"));
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(victim), {}), "precious");
    EXPECT_FALSE(std::filesystem::exists(path("escaped")));
  }
}

// By all kinds together.
TEST_F(ConfineTest, NoMemoryPassesTheLimit) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers reserve more memory than any limit";
  constexpr std::size_t limit = 32 * block;
  void* const shared = ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  auto* const taken = static_cast<std::size_t*>(shared);
  std::array<int, 2> sockets{};
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    confine_reader(sockets[0], {limit});
    for (const int flags : {MAP_SHARED, MAP_SHARED_VALIDATE, MAP_PRIVATE | MAP_GROWSDOWN, MAP_PRIVATE})
      for (int i = 0; i < 64; ++i) {
        char* const memory = take(PROT_READ | PROT_WRITE, flags | MAP_ANONYMOUS);
        if (memory == nullptr) break;
        static_cast<void>(::mprotect(memory, block, PROT_READ));
        ++*taken;
      }
    ::_exit(0);
  }
  ::waitpid(child, nullptr, 0);
  ::close(sockets[0]);
  ::close(sockets[1]);
  EXPECT_LE(*taken, 32u);
  EXPECT_GE(*taken, 16u) << "private memory";
  ::munmap(shared, 4096);
}

TEST_F(ConfineTest, AReaderInAnEndlessLoopEndsWithTheProgramThatStartedIt) {
  std::array<int, 2> sockets{};
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets.data()), 0);
  const pid_t reader = ::fork();
  if (reader == 0) {
    ::close(sockets[1]);
    confine_reader(sockets[0], {plenty});
    for (volatile bool forever = true; forever;) {
    }
  }
  const pid_t program = ::fork();
  if (program == 0) {
    ::close(sockets[0]);
    for (;;) ::pause();
  }
  ::close(sockets[0]);
  ::close(sockets[1]);
  ::usleep(100000);
  EXPECT_EQ(::waitpid(reader, nullptr, WNOHANG), 0);
  ::kill(program, SIGKILL);
  ::waitpid(program, nullptr, 0);
  int status = 0;
  EXPECT_EQ(::waitpid(reader, &status, 0), reader);
  EXPECT_EQ(WEXITSTATUS(status), 1);
}

/// Returns the processes that this one has started.
std::vector<std::filesystem::path> children() {
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    std::ifstream file(entry.path() / "status");
    for (std::string line; std::getline(file, line);)
      if (line == "PPid:\t" + std::to_string(::getpid())) found.push_back(entry.path());
  }
  return found;
}

TEST_F(ConfineTest, EveryThreadOfTheProgramIsConfined) {
  ReaderProcess reader(reader_options());
  const auto source = value_of(
      reader.open({write("points.vtk",
                         legacy_file("STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 8\n"
                                     "SCALARS f float 1\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n"))},
                  {}));
  ASSERT_EQ(children().size(), 1u);
  for (const auto& thread : std::filesystem::directory_iterator(children()[0] / "task")) {
    std::stringstream text;
    text << std::ifstream(thread.path() / "status").rdbuf();
    EXPECT_THAT(text.str(), testing::HasSubstr("NoNewPrivs:\t1\n")) << thread.path();
    EXPECT_THAT(text.str(), testing::HasSubstr("Seccomp:\t2\n")) << thread.path();
  }
}

}  // namespace
}  // namespace splatvol::test
