// Runs a program of this project beside the test, with pipes to it.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/require.h"

extern char** environ;

namespace splatvol::test {

/// How long a test waits for what must happen.
inline constexpr std::chrono::seconds patience{120};

/// Waits until something is so. Returns whether it is.
inline bool becomes(const std::function<bool()>& is_so) {
  const auto end = std::chrono::steady_clock::now() + patience;
  while (!is_so() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return is_so();
}

/// A shell that runs a command line in a folder. Programs of this project are found by their names. It ends with this
/// object. `exec PROGRAM ...` makes the program itself the child.
class Child {
 public:
  Child(const std::string& folder, const std::string& command_line) {
    std::array<int, 2> input{}, output{};
    require(::pipe2(input.data(), O_CLOEXEC) == 0 && ::pipe2(output.data(), O_CLOEXEC) == 0, "pipe");
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, input[0], STDIN_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, output[1], STDOUT_FILENO);
    std::string script = "cd '" + folder + "' && PATH='" SPLATVOL_BIN "':\"$PATH\" && " + command_line;
    std::array<char*, 4> words = {const_cast<char*>("sh"), const_cast<char*>("-c"), script.data(), nullptr};
    require(::posix_spawn(&process_, "/bin/sh", &actions, nullptr, words.data(), environ) == 0, "sh");
    ::posix_spawn_file_actions_destroy(&actions);
    ::close(input[0]);
    ::close(output[1]);
    input_ = input[1];
    output_ = output[0];
  }
  ~Child() {
    end_input();
    if (process_ > 0) send(SIGKILL);
    if (process_ > 0) (void)status();
    ::close(output_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  [[nodiscard]] pid_t process() const { return process_; }
  void send(int signal) const { ::kill(process_, signal); }

  /// Closes its standard input.
  void end_input() {
    if (input_ >= 0) ::close(input_);
    input_ = -1;
  }

  /// Returns the next line that it prints, without the line's end; nothing once it prints no more.
  std::optional<std::string> line() {
    for (;;) {
      if (const std::size_t end = text_.find('\n'); end != std::string::npos) {
        const std::string found = text_.substr(0, end);
        text_.erase(0, end + 1);
        return found;
      }
      pollfd waited{output_, POLLIN, 0};
      std::array<char, 4096> part;
      const auto most = static_cast<int>(std::chrono::milliseconds(patience).count());
      const ssize_t got = ::poll(&waited, 1, most) > 0 ? ::read(output_, part.data(), part.size()) : 0;
      if (got <= 0) return std::nullopt;
      text_.append(part.data(), static_cast<std::size_t>(got));
    }
  }

  /// Waits for its end. Returns its status, as waitpid does.
  int status() {
    int status = -1;
    require(::waitpid(process_, &status, 0) == process_, "waitpid");
    process_ = -1;
    return status;
  }

 private:
  pid_t process_ = -1;
  int input_ = -1, output_ = -1;
  std::string text_;
};

}  // namespace splatvol::test
