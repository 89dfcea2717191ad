// Other programs.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// The exit code of a program that is not there.
inline constexpr int no_program = 127;

/// Returns the path of a program beside this one if it is there, else its name, which PATH finds.
[[nodiscard]] std::string program_beside_this(const std::string& name);

/// Files that a program reads as its input, and writes its words to.
struct ProgramFiles {
  std::string input = "/dev/null";
  std::string log = "/dev/null";
};

/// Runs a program that PATH finds, without a shell, and waits for its end. `words`: its name and its arguments. Returns
/// its exit code; `no_program` if there is none, 126 if a signal ended it.
[[nodiscard]] int run_program(const std::vector<std::string>& words, const ProgramFiles& files = {});

/// A program that runs beside this one. Its input is a pipe that stays open, its stderr is dropped. SIGINT ends it,
/// also if this program ignores that. Not thread-safe.
class RunningProgram {
 public:
  /// Starts a program that PATH finds, without a shell. `words`: its name and its arguments.
  [[nodiscard]] static Result<std::unique_ptr<RunningProgram>> start(const std::vector<std::string>& words);

  /// Interrupts it if it still runs, and waits for its end.
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// Returns the next whole line of what it prints, without its end; none if there is none yet after `time`, or none
  /// any more. A line of more than 1 MiB comes in parts.
  [[nodiscard]] std::optional<std::string> read_line(std::chrono::milliseconds time);

  /// Whether it prints nothing more, and all lines have been read.
  [[nodiscard]] bool is_silent() const { return output_ < 0 && text_.empty(); }

  /// Ends its input, and waits for its end. Returns its exit code; none if a signal ended it. Called once.
  [[nodiscard]] std::optional<int> finish();

 private:
  RunningProgram(pid_t process, int input, int output) : process_(process), input_(input), output_(output) {}

  pid_t process_;  // 0: it has ended
  int input_;      // -1: closed, as for the output
  int output_;
  std::string text_;  // read of the output, and not yet returned
};

/// A program that this one talks to. Its input and output are one socket: no signal SIGPIPE comes of it, and nothing
/// waits longer than it is told. Not thread-safe, but one thread may send while another receives.
class ConnectedProgram {
 public:
  /// Starts a program that PATH finds, without a shell. `words`: its name and its arguments.
  [[nodiscard]] static Result<std::unique_ptr<ConnectedProgram>> start(const std::vector<std::string>& words);

  /// Ends it by SIGTERM, or after a second by SIGKILL, and waits for its end.
  ~ConnectedProgram();
  ConnectedProgram(const ConnectedProgram&) = delete;
  ConnectedProgram& operator=(const ConnectedProgram&) = delete;

  /// Sends as many bytes as it takes at once, and removes them from the front.
  void send(std::string& bytes) const;

  /// Waits for bytes, or until it takes some if `has_more` to send. Returns how many bytes `out` has got, possibly
  /// none; nothing if there will be no more.
  [[nodiscard]] std::optional<std::size_t> receive(std::span<std::byte> out, std::chrono::milliseconds time,
                                                   bool has_more);

  /// After its end: returns the last line that it wrote to stderr. Waits up to a second until it has ended.
  [[nodiscard]] std::string last_line();

 private:
  ConnectedProgram(pid_t process, int socket, int errors) : process_(process), socket_(socket), errors_(errors) {}
  void read_errors();

  pid_t process_;
  int socket_;
  int errors_;              // -1: closed
  std::string error_text_;  // its end
};

}  // namespace splatvol
