// Shared by all programs: exit codes, one line for an error, a progress bar, sizes such as "2G".
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/printable.h"
#include "base/replaceable.h"
#include "tools/command_line.h"

namespace splatvol {

/// Parses the command line and runs `body`. Returns the exit code of the process: 0 for success, 1 for bad data or a
/// bad file (with one line on stderr, "tool: reason"), 2 for wrong usage. --help and --version print and return 0,
/// and so do --help-man and --completion SHELL, which the help leaves out: the man page, and a script for bash, zsh or
/// fish.
int run_tool(CommandLine& app, int argc, char** argv, const std::function<Status()>& body);

/// Prints to stdout, without the control characters that names and texts of files may hold (base/printable.h).
template <class... Args>
void print_out(fmt::format_string<Args...> format, Args&&... args) {
  fmt::print("{}", printable(fmt::format(format, std::forward<Args>(args)...)));
}

/// Puts the value of a result into `target`. Fails, and leaves `target` as it is, if there is none.
template <class T, class Target>
[[nodiscard]] Status store(Result<T> result, Target& target) {
  if (!result) return tl::unexpected(result.error());
  target = std::move(*result);
  return {};
}

/// Fails if an output is the same file as an input, even by another name, or if two outputs have the same name. Fails
/// also if writing would replace a file that it may not (base/replaceable.h). Empty names and "-" are no files.
[[nodiscard]] Status check_outputs(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs,
                                   Replace replace = Replace::exports);

/// Adds --force, for a program that writes files of a kind that is also an input. It sets `replace` to Replace::any.
void add_force_option(CommandLine& app, Replace& replace);

/// Shows a bar and the time left on stderr. Prints nothing unless stderr is a terminal.
class ProgressBar {
 public:
  explicit ProgressBar(std::string stage);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// Draws at most ten times a second; `fraction` in [0, 1].
  void update(double fraction);

  /// From now on, it shows another stage of the same work.
  void rename(const std::string& stage) { stage_ = stage; }

 private:
  std::string stage_;
  bool visible_;
  double start_;
  double last_drawn_ = 0;
};

/// Reads a number of bytes: "65536", "64K", "1.5G" (powers of 1024; K, M, G, T, with or without iB).
[[nodiscard]] Result<std::uint64_t> parse_bytes(const std::string& text);

/// Reads so many numbers with commas between them, of at most 1e100 in size; none if the text is something else.
[[nodiscard]] std::optional<std::vector<double>> parse_numbers(std::string_view text, std::size_t count);

/// A default for --memory: SPLATVOL_MEMORY of the environment; else so many MiB, or half of what this process may have,
/// if that is less.
[[nodiscard]] std::string default_memory(std::uint64_t mebibytes);

/// Reads the text of --memory. Empty: SPLATVOL_MEMORY of the environment, else a quarter of what this process may have.
[[nodiscard]] Result<std::uint64_t> memory_or_quarter(const std::string& text);

/// A default for --threads: SPLATVOL_THREADS of the environment; else 0: all.
[[nodiscard]] unsigned default_threads();

/// Reads a picture's size such as "640x480"; sides from 1 to 16384.
[[nodiscard]] Result<std::array<int, 2>> parse_image_size(const std::string& text);

/// Each is an OptionCheck (command_line.h).
[[nodiscard]] std::string check_not_empty(const std::string& text);
[[nodiscard]] std::string check_svol_path(const std::string& text);
[[nodiscard]] std::string check_npy_path(const std::string& text);
[[nodiscard]] std::string check_json_path(const std::string& text);  // "-" is taken too
[[nodiscard]] std::string check_positive(const std::string& text);   // and finite
[[nodiscard]] std::string check_finite(
    const std::string& text);  // neither infinite nor NaN; CLI11 itself refuses words

/// Seconds since an arbitrary fixed moment.
[[nodiscard]] double seconds_now();

}  // namespace splatvol
