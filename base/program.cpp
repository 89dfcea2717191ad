#include "base/program.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "base/descriptor.h"
#include "base/interruption.h"

extern char** environ;

namespace splatvol {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds second{1};
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

// Starts a program with these descriptors as its standard streams. `errors` < 0: they are dropped.
Result<pid_t> start_program(const std::vector<std::string>& words, int input, int output, int errors) {
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, input, 0);
  ::posix_spawn_file_actions_adddup2(&actions, output, 1);
  if (errors >= 0)
    ::posix_spawn_file_actions_adddup2(&actions, errors, 2);
  else
    ::posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t usual, none;
  ::sigemptyset(&none);
  ::sigemptyset(&usual);
  for (const int signal : {SIGINT, SIGTERM}) ::sigaddset(&usual, signal);
  ::posix_spawnattr_setsigdefault(&attributes, &usual);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  std::vector<char*> arguments = arguments_of(words);
  pid_t process = 0;
  const int error = ::posix_spawnp(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return fail(ErrorCode::io, "cannot start {}: {}", words[0], std::strerror(error));
  return process;
}

}  // namespace

std::string program_beside_this(const std::string& name) {
  std::error_code error;
  const auto beside = std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / name;
  return !error && std::filesystem::exists(beside, error) ? beside.string() : name;
}

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
  const auto process = start_program(words, input[0], output[1], -1);
  if (!process) {
    close_all();
    return tl::unexpected(process.error());
  }
  close_once(input[0]);
  close_once(output[1]);
  return std::unique_ptr<RunningProgram>(new RunningProgram(*process, input[1], output[0]));
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

Result<std::unique_ptr<ConnectedProgram>> ConnectedProgram::start(const std::vector<std::string>& words) {
  std::array<int, 2> ends{-1, -1}, errors{-1, -1};
  const auto close_all = [&] {
    for (int* descriptor : {&ends[0], &ends[1], &errors[0], &errors[1]}) close_once(*descriptor);
  };
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0 ||
      ::pipe2(errors.data(), O_CLOEXEC) != 0) {
    const auto failure = fail_errno(words[0], "cannot make a socket");
    close_all();
    return failure;
  }
  const auto process = start_program(words, ends[1], ends[1], errors[1]);
  if (!process) {
    close_all();
    return tl::unexpected(process.error());
  }
  close_once(ends[1]);
  close_once(errors[1]);
  return std::unique_ptr<ConnectedProgram>(new ConnectedProgram(*process, ends[0], errors[0]));
}

ConnectedProgram::~ConnectedProgram() {
  close_once(socket_);
  close_once(errors_);
  ::kill(process_, SIGTERM);
  const auto end = Clock::now() + second;
  while (uninterrupted([&] { return ::waitpid(process_, nullptr, WNOHANG); }) == 0) {
    if (Clock::now() > end) {
      ::kill(process_, SIGKILL);
      wait_for(process_);
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void ConnectedProgram::send(std::string& bytes) const {
  const ssize_t sent =
      uninterrupted([&] { return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT); });
  if (sent > 0) bytes.erase(0, static_cast<std::size_t>(sent));
}

std::optional<std::size_t> ConnectedProgram::receive(std::span<std::byte> out, std::chrono::milliseconds time,
                                                     bool has_more) {
  std::array<pollfd, 2> waiting{{{socket_, static_cast<short>(has_more ? POLLIN | POLLOUT : POLLIN), 0},  // NOLINT
                                 {errors_, POLLIN, 0}}};
  if (::poll(waiting.data(), waiting.size(), static_cast<int>(time.count())) <= 0) return 0;
  if (waiting[1].revents != 0) read_errors();
  if ((waiting[0].revents & ~POLLOUT) == 0) return 0;
  const ssize_t got = ::recv(socket_, out.data(), out.size(), MSG_DONTWAIT);
  if (got > 0) return static_cast<std::size_t>(got);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
  return {};
}

// Reads what is there.
void ConnectedProgram::read_errors() {
  constexpr std::size_t most_bytes = 4096;
  std::array<char, most_bytes> bytes;
  const ssize_t count = uninterrupted([&] { return ::read(errors_, bytes.data(), bytes.size()); });
  if (count <= 0) return close_once(errors_);
  error_text_.append(bytes.data(), static_cast<std::size_t>(count));
  if (error_text_.size() > most_bytes) error_text_.erase(0, error_text_.size() - most_bytes);
}

std::string ConnectedProgram::last_line() {
  const auto end = Clock::now() + second;
  while (errors_ >= 0 && Clock::now() < end && !is_interrupted()) {
    pollfd waiting{errors_, POLLIN, 0};
    if (::poll(&waiting, 1, static_cast<int>(interruption_delay.count())) > 0) read_errors();
  }
  std::string_view text = error_text_;
  while (text.ends_with('\n') || text.ends_with('\r')) text.remove_suffix(1);
  return std::string(text.substr(text.find_last_of("\r\n") + 1));
}

}  // namespace splatvol
