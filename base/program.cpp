#include "base/program.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include "base/descriptor.h"

extern char** environ;

namespace splatvol {
namespace {

constexpr std::size_t longest_line = std::size_t{1} << 20;

// The arguments of posix_spawnp, which changes none of them.
std::vector<char*> arguments_of(const std::vector<std::string>& words) {
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  return arguments;
}

int wait_for(pid_t process) {
  int status = 0;
  static_cast<void>(uninterrupted([&] { return ::waitpid(process, &status, 0); }));
  return status;
}

void close_once(int& descriptor) {
  if (descriptor >= 0) ::close(std::exchange(descriptor, -1));
}

}  // namespace

int run_program(const std::vector<std::string>& words, const ProgramFiles& files) {
  std::vector<char*> arguments = arguments_of(words);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, 0, files.input.c_str(), O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, 1, files.log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  ::posix_spawn_file_actions_adddup2(&actions, 1, 2);
  pid_t child = 0;
  const int error = ::posix_spawnp(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return no_program;
  const int status = wait_for(child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 126;
}

Result<std::unique_ptr<RunningProgram>> RunningProgram::start(const std::vector<std::string>& words) {
  // Of each pair, the program gets copies that outlive exec, and no others.
  std::array<int, 2> input{-1, -1}, output{-1, -1};
  const auto close_all = [&] {
    for (int* descriptor : {&input[0], &input[1], &output[0], &output[1]}) close_once(*descriptor);
  };
  if (::pipe2(input.data(), O_CLOEXEC) != 0 || ::pipe2(output.data(), O_CLOEXEC) != 0) {
    const auto failure = fail_errno(words[0], "cannot make a pipe");
    close_all();
    return failure;
  }
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, input[0], 0);
  ::posix_spawn_file_actions_adddup2(&actions, output[1], 1);
  ::posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t usual;
  ::sigemptyset(&usual);
  ::sigaddset(&usual, SIGINT);
  ::posix_spawnattr_setsigdefault(&attributes, &usual);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> arguments = arguments_of(words);
  pid_t process = 0;
  const int error = ::posix_spawnp(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0) {
    close_all();
    return fail(ErrorCode::io, "cannot start {}: {}", words[0], std::strerror(error));
  }
  close_once(input[0]);
  close_once(output[1]);
  return std::unique_ptr<RunningProgram>(new RunningProgram(process, input[1], output[0]));
}

RunningProgram::~RunningProgram() {
  if (process_ == 0) return;
  ::kill(process_, SIGINT);
  static_cast<void>(finish());
}

std::optional<std::string> RunningProgram::read_line(std::chrono::milliseconds time) {
  for (;;) {
    const std::size_t end = std::min(text_.find('\n'), text_.size());
    if (end < text_.size() || end >= longest_line || (output_ < 0 && end > 0)) {
      std::string line = text_.substr(0, end);
      text_.erase(0, std::min(end + 1, text_.size()));
      return line;
    }
    if (output_ < 0) return {};
    pollfd waiting{output_, POLLIN, 0};
    if (uninterrupted([&] { return ::poll(&waiting, 1, static_cast<int>(time.count())); }) <= 0) return {};
    std::array<char, 65536> bytes;
    const ssize_t count = uninterrupted([&] { return ::read(output_, bytes.data(), bytes.size()); });
    if (count > 0)
      text_.append(bytes.data(), static_cast<std::size_t>(count));
    else
      close_once(output_);
  }
}

std::optional<int> RunningProgram::finish() {
  close_once(input_);
  close_once(output_);
  const int status = wait_for(std::exchange(process_, 0));
  return WIFEXITED(status) ? std::optional<int>(WEXITSTATUS(status)) : std::nullopt;
}

}  // namespace splatvol
