// Programs on a system that refuses: handles, memory, bytes on disk, inputs that shrink. Each ends as asked, or with
// one line and exit code 1, and leaves nothing half-written. A sample takes fewer of the places where a system may
// refuse.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <thread>
#include <vector>

#include "base/memory_limit.h"
#include "tests/support/long.h"
#include "tests/support/programs.h"
#include "tests/support/require.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;

struct Faults : ProgramTest {
  Faults() {
    fs::create_directory(out());
    // The programs inherit no handle but the three of the shell: the limits below count them.
    std::vector<int> handles;
    for (const auto& entry : fs::directory_iterator("/proc/self/fd"))
      handles.push_back(std::stoi(entry.path().filename()));
    for (const int handle : handles)
      if (handle > STDERR_FILENO) ::fcntl(handle, F_SETFD, FD_CLOEXEC);
  }

  void make_inputs(const std::string& points = "3000") const {
    expect_done("svbuild gen:points:count=" + points + " -o a.svol");
    expect_done("svgen points --count " + points + " -o a.npy");
  }

  // Expects success, or one line, exit code 1 and no output. Returns whether it is success.
  bool expect_success_or_one_line(const std::string& command) const {
    for (const auto& entry : fs::directory_iterator(out())) fs::remove_all(entry.path());
    const Outcome outcome = run(command);
    EXPECT_THAT(outcome.code, testing::AnyOf(0, 1)) << command << "\n" << outcome.err;
    if (outcome.code == 0) return true;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << command << "\n" << outcome.err;
    EXPECT_TRUE(fs::is_empty(out())) << command << " left " << fs::directory_iterator(out())->path();
    return false;
  }

  // What stands before a command whose n-th block of memory is refused (tests/support/failing_new.cpp).
  static std::string without_block(long n, const std::string& mode) {
    return "LD_PRELOAD=" SPLATVOL_FAILING_NEW " SPLATVOL_FAIL_AT=" + std::to_string(n) + " " + mode;
  }

  fs::path out() const { return path("out"); }
};

// What each program does, as a user would call it.
constexpr const char* uses[] = {
    "svbuild a.npy -o out/b.svol --memory 100M",
    "svinfo --verify a.svol",
    "svrender a.svol --device cpu --size 64x48 --memory 20M -o out/a.png",
    "svexport a.svol -o out/a.vtu",
    "svgen points --count 3000 -o out/b.npy",
};

TEST_F(Faults, SixteenHandlesAreEnough) {
  make_inputs();
  for (const std::string use : uses) EXPECT_TRUE(expect_success_or_one_line("ulimit -n 16; " + use)) << run(use).err;
}

TEST_F(Faults, FewerHandlesAreTold) {
  make_inputs();
  for (const std::string use : uses)
    for (int handles = 4; handles < 16; handles += is_long() ? 1 : 5)
      expect_success_or_one_line("ulimit -n " + std::to_string(handles) + "; " + use);
}

TEST_F(Faults, AFullDiskIsToldAtEveryByte) {
  make_inputs();
  for (const std::string use : {uses[0], uses[2], uses[3], uses[4]}) {
    int refused = 0;
    // The shell's unit is 512 or 1024 bytes.
    for (int kibibytes = 1; kibibytes < 4096; kibibytes = kibibytes * (is_long() ? 3 : 12) / 2 + 1)
      if (!expect_success_or_one_line("ulimit -f " + std::to_string(kibibytes) + "; " + use)) ++refused;
    EXPECT_GT(refused, 0) << use;
  }
}

// As in a container, or a system in trouble. Files without a name could not get one.
TEST_F(Faults, WithoutProcProgramsWork) {
  const std::string without_proc = "unshare -rm sh -c 'mount -t tmpfs none /proc && exec \"$@\"' sh ";
  if (run(without_proc + "true").code != 0) GTEST_SKIP() << "no namespaces here";
  make_inputs();
  for (const std::string use : uses) EXPECT_TRUE(expect_success_or_one_line(without_proc + use)) << run(use).err;
  EXPECT_TRUE(expect_success_or_one_line(without_proc + "svgen flow --points 1000 -o out/d.vtu"));
}

// Memory for a picture of 2^28 pixels is not there.
TEST_F(Faults, APictureThatDoesNotFitIsTold) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers take address space of their own";
  make_inputs();
  EXPECT_FALSE(
      expect_success_or_one_line("ulimit -v 2000000; svrender a.svol --device cpu --size 16384x16384 -o out/a.png"));
}

// Its numbers take more than 2 GiB: 32 bits do not hold their bytes. Other tests beside it would want the memory, too.
TEST_F(Faults, APictureOfMoreThan2To27PixelsIsWhole) {
  if (!is_long() || is_sanitized || memory_limit() < std::uint64_t{4} << 30)
    GTEST_SKIP() << "takes 3 GiB and the whole machine: ctest -L long";
  make_inputs();
  EXPECT_TRUE(expect_success_or_one_line("svrender a.svol --device cpu --size 16384x8200 -o out/a.png"));
  EXPECT_EQ(read("out/a.png").substr(16, 8), std::string("\0\0\x40\0\0\0\x20\x08", 8));  // width and height
}

// So many points that each resolution has several rows, which wait in temporary files.
TEST_F(Faults, SixteenHandlesAreEnoughForALargeBuild) {
  expect_done("svgen points --count 1000000 -o a.npy");
  EXPECT_TRUE(
      expect_success_or_one_line("ulimit -n 16; svbuild a.npy --memory 64M --connectivity boxes -o out/b.svol"));
}

// VTK writes the mesh. Its dumps of objects are no error for a user.
TEST_F(Faults, AFullDiskIsToldByVtksWriterToo) {
  for (const std::string use : {"svgen mesh --cells 3000 -o out/m", "svgen flow --points 1000 -o out/d.vtu"})
    for (const char* blocks : {"1", "2", "8", "16"})
      EXPECT_FALSE(expect_success_or_one_line("ulimit -f " + std::string(blocks) + "; " + use)) << use << blocks;
}

TEST_F(Faults, AddressSpaceThatEndsIsTold) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers take address space of their own";
  make_inputs(is_long() ? "20000" : "3000");
  for (const std::string use : uses) {
    int succeeded = 0;
    const int step = is_long() ? 6 : 38;
    for (int mebibytes = 60; mebibytes < 2000; mebibytes += mebibytes < 250 ? step : mebibytes * step / 24) {
      const std::string limited = "ulimit -v " + std::to_string(mebibytes * 1024) + "; ";
      if (run(limited + use.substr(0, use.find(' ')) + " --version").code != 0) continue;  // its libraries do not load
      if (expect_success_or_one_line(limited + use)) ++succeeded;
    }
    EXPECT_GT(succeeded, 0) << use;
  }
}

// As under a limit on processes (ulimit -u, pids.max). Some libraries start threads before `main`.
TEST_F(Faults, FewThreadsAreEnoughOrAreTold) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers start threads of their own";
  make_inputs();
  for (const std::string use : uses)
    for (const int threads : sample_of<int>({1, 3, 0, 2, 5, 8, 13}, 2))
      expect_success_or_one_line("ulimit -S -u 100000 2> /dev/null; SPLATVOL_THREADS=" + std::to_string(threads) +
                                 " LD_PRELOAD=" SPLATVOL_NO_THREADS " timeout 60 " + use);
}

// Graphics drivers end a program where they get no memory: they are not asked.
TEST_F(Faults, TooLittleAddressSpaceForOpenGlIsTold) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers take address space of their own";
  if (!fs::exists(SPLATVOL_BIN "/svview")) GTEST_SKIP() << "built without OpenGL";
  make_inputs();
  for (const std::string use : {"svview a.svol --size 64x48 --screenshot out/a.png --memory 20M",
                                "svrender a.svol --device gl --size 64x48 -o out/a.png --memory 20M"})
    for (const char* mebibytes : {"240", "400", "500", "700", "900", "1200", "1500"}) {
      const std::string limited = "ulimit -v $((" + std::string(mebibytes) + " * 1024)); ";
      if (run(limited + use.substr(0, use.find(' ')) + " --version").code != 0) continue;  // its libraries do not load
      expect_success_or_one_line(limited + use);
    }
}

TEST_F(Faults, MemoryThatRunsOutIsTold) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers have an operator new of their own";
  make_inputs();
  for (const std::string use : uses) {
    int refused = 0;
    for (int n = 0; n < 500; n += 1 + (is_long() ? n / 8 : 3 * n)) {
      if (!expect_success_or_one_line(without_block(n, "SPLATVOL_FAIL_LEAST=16384 ") + use)) ++refused;
    }
    EXPECT_GT(refused, 0) << use;
  }
}

// Of all sizes: from one block on, and that block alone. Without CGAL's threads: if one of them ends by an exception,
// it keeps its locks, and the others wait for ever.
TEST_F(Faults, EveryBlockOfMemoryMayBeTheLast) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers have an operator new of their own";
  make_inputs();
  for (std::string use : uses)
    for (const std::string mode : {"", "SPLATVOL_FAIL_ONCE=1 "}) {
      if (use == uses[0]) use += " --connectivity none";
      int refused = 0;
      for (long n = 0; n < 200'000; n += 1 + (is_long() ? n / 3 : 4 * n))
        if (!expect_success_or_one_line(without_block(n, mode) + "timeout 60 " + use)) ++refused;
      EXPECT_GT(refused, 0) << use;
    }
}

TEST_F(Faults, TwoBuildsToOneOutputLeaveOneOfBoth) {
  make_inputs(is_long() ? "200000" : "20000");
  const std::string other = std::string("svbuild gen:points:count=") + (is_long() ? "150000" : "15000");
  expect_done("svbuild a.npy -o first.svol && " + other + " -o second.svol");
  const Outcome both = run("svbuild a.npy -o out/b.svol & " + other + " -o out/b.svol && wait $!");
  EXPECT_EQ(both.code, 0) << both.err;
  EXPECT_TRUE(read("out/b.svol") == read("first.svol") || read("out/b.svol") == read("second.svol"));
  EXPECT_EQ(std::distance(fs::directory_iterator(out()), {}), 1);
}

// Cuts a file off once it was read so many times: after its opening if that is 0. Reads that follow each other at once
// may count as one.
class CutWhileRead {
 public:
  CutWhileRead(const fs::path& file, int reads) : events_(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC)) {
    require(::inotify_add_watch(events_, file.c_str(), reads == 0 ? IN_OPEN : IN_ACCESS) >= 0, file.string());
    thread_ = std::jthread([this, file, reads](const std::stop_token& stop) {
      inotify_event event{};
      for (int seen = 0; !stop.stop_requested();) {
        pollfd ready{events_, POLLIN, 0};
        ::poll(&ready, 1, 10);
        while (::read(events_, &event, sizeof(event)) > 0)
          if (++seen >= reads) return fs::resize_file(file, fs::file_size(file) / 3);
      }
    });
  }
  ~CutWhileRead() {
    thread_ = {};
    ::close(events_);
  }

 private:
  int events_;
  std::jthread thread_;
};

// A file is cut off at any moment of a program's work on it: what was read before may be enough.
TEST_F(Faults, InputsThatShrinkAreTold) {
  make_inputs(is_long() ? "200000" : "20000");
  expect_done("svexport a.svol -o a.vtu");
  for (const auto& [name, use] : {std::pair<std::string, std::string>{"a.npy", "svbuild x/a.npy -o out/b.svol"},
                                  {"a.vtu", "svbuild x/a.vtu -o out/b.svol"},
                                  {"a.svol", "svrender x/a.svol --device cpu --tolerance 0 --size 64x48 -o out/a.png"},
                                  {"a.svol", "svexport x/a.svol -o out/a.vtu"}}) {
    for (const int reads : {0, 1, 2, 5, 12}) {
      const CutWhileRead cut(write("x/" + name, read(name)), reads);
      expect_success_or_one_line(use);
    }
  }
}

}  // namespace
}  // namespace splatvol::test
