// Signals that end a program in the middle of its work, where the file system has no files without a name: nothing
// stays, and the program ends by the signal.
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>

#include <array>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;

struct Signals : FolderTest {
  void SetUp() override {
    if (is_sanitized) GTEST_SKIP() << "sanitizers have handlers of their own";
  }

  static pid_t start(std::vector<std::string> words) {
    words[0] = SPLATVOL_BIN "/" + words[0];
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    std::array<char*, 2> environment = {const_cast<char*>("LD_PRELOAD=" SPLATVOL_NO_TMPFILE), nullptr};
    pid_t process = -1;
    EXPECT_EQ(::posix_spawn(&process, arguments[0], nullptr, nullptr, arguments.data(), environment.data()), 0);
    return process;
  }

  // Returns how the program ended that gets the signal once it writes. It must not be through before.
  int end_by(int signal, const std::vector<std::string>& words) const {
    const pid_t process = start(words);
    for (int i = 0; i < 5000 && fs::is_empty(folder_); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    EXPECT_FALSE(fs::is_empty(folder_)) << "nothing is written";
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    ::kill(process, signal);
    int status = -1;
    EXPECT_EQ(::waitpid(process, &status, 0), process);
    return status;
  }
};

TEST_F(Signals, EveryOneThatEndsAProgramLeavesNothing) {
  const std::vector<std::string> long_work = {"svgen", "points", "--count", "1e9", "-o", path("a.npy")};
  std::vector<int> signals = {SIGHUP,  SIGINT,  SIGQUIT, SIGILL,  SIGTRAP, SIGABRT, SIGBUS, SIGFPE,  SIGUSR1,  SIGSEGV,
                              SIGUSR2, SIGPIPE, SIGALRM, SIGTERM, SIGXCPU, SIGPROF, SIGSYS, SIGPOLL, SIGVTALRM};
  signals.push_back(SIGRTMIN);
  for (const int signal : signals) {
    const int status = end_by(signal, long_work);
    EXPECT_TRUE(WIFSIGNALED(status)) << signal;
    EXPECT_EQ(WTERMSIG(status), signal);
    EXPECT_TRUE(fs::is_empty(folder_)) << signal << " left " << fs::directory_iterator(folder_)->path();
  }
}

TEST_F(Signals, AFolderThatIsBeingWrittenGoesToo) {
  const int status = end_by(SIGTERM, {"svgen", "mesh", "--cells", "1e8", "--pieces", "1000", "-o", path("a")});
  EXPECT_EQ(WTERMSIG(status), SIGTERM);
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(Signals, ABuildLeavesNothing) {
  const int status =
      end_by(SIGQUIT, {"svbuild", "gen:points:count=1e7", "--connectivity", "none", "-o", path("a.svol")});
  EXPECT_EQ(WTERMSIG(status), SIGQUIT);
  EXPECT_TRUE(fs::is_empty(folder_));
}

}  // namespace
}  // namespace splatvol::test
