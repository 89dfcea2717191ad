#include "tools/tool.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <string_view>

#include "base/memory_limit.h"
#include "base/names.h"
#include "base/printable.h"
#include "tools/ending.h"
#include "tools/limits.h"
#include "tools/program_options.h"
#include "tools/version.h"

namespace splatvol {

namespace {

// Defaults of options, told by the environment.
constexpr const char* memory_variable = "SPLATVOL_MEMORY";
constexpr const char* threads_variable = "SPLATVOL_THREADS";
constexpr int most_threads = 4096;

// Returns a variable's text; empty: it is not set.
std::string environment(const char* name) {
  const char* text = std::getenv(name);
  return text ? text : "";
}

// A program that is started without them would write what belongs there into its first files.
void open_standard_streams() {
  for (int stream = ::open("/dev/null", O_RDWR); stream >= 0; stream = ::dup(stream))
    if (stream > STDERR_FILENO) {
      ::close(stream);
      return;
    }
}

// By default a thread keeps tens of MiB of freed memory once large blocks have been freed. With fixed thresholds it
// goes back to the system: svview stays within what was granted.
void return_freed_memory() {
#ifdef M_TRIM_THRESHOLD
  ::mallopt(M_MMAP_THRESHOLD, 1 << 20);
  ::mallopt(M_TRIM_THRESHOLD, 1 << 20);
#endif
}

// Prints an error if it can be printed.
int fail_with(CommandLine& app, std::string_view message) {
  say(app.get_name(), message);
  return 1;
}

// The man page or the completions, if the command line asks for them. Neither is in the help: the build makes files of
// them (tools/CMakeLists.txt).
std::string text_for_installation(CommandLine& app, int argc, char** argv) {
  const std::string_view option = argc > 1 ? argv[1] : "";
  const std::string name = std::filesystem::path(app.get_name().empty() ? argv[0] : app.get_name()).filename();
  if (argc == 2 && option == "--help-man") return man_page(options_of(app.parser(), name), SPLATVOL_VERSION);
  if (argc == 3 && option == "--completion") return completion(options_of(app.parser(), name), argv[2]);
  return "";
}

std::string check_path(const std::string& path, const std::string& extension) {
  return has_extension(path, extension) ? "" : fmt::format("'{}' does not end in {}", path, extension);
}

int print_fully(CommandLine& app, std::string_view text) {
  const bool printed = static_cast<bool>((std::cout << text).flush());
  return printed ? 0 : fail_with(app, "cannot write to the standard output");
}

void add_options(const CLI::App& app, std::vector<std::string>& names) {
  for (const CLI::Option* option : app.get_options({})) {
    for (const std::string& name : option->get_lnames()) names.push_back(fmt::format("--{}", name));
    for (const std::string& name : option->get_snames()) names.push_back(fmt::format("-{}", name));
  }
  for (const CLI::App* command : app.get_subcommands({})) add_options(*command, names);
}

// What is wrong with the first option that there is not; empty: there are all. A number may begin as an option does.
std::string unknown_option(const CLI::App& app, std::span<char* const> arguments) {
  std::vector<std::string> names;
  add_options(app, names);
  const std::vector<std::string_view> known(names.begin(), names.end());
  for (const std::string_view argument : arguments) {
    if (argument == "--") break;
    if (argument.size() < 2 || argument[0] != '-' || argument[1] == '.' || (argument[1] >= '0' && argument[1] <= '9'))
      continue;
    const bool is_long = argument[1] == '-';
    const std::string_view name = is_long ? argument.substr(0, argument.find('=')) : argument.substr(0, 2);
    if (std::ranges::find(known, name) != known.end()) continue;
    return fmt::format("{}: no such option; the nearest is {}", name, nearest_name(name, known));
  }
  return "";
}

// Fails if a default that the environment tells is none.
Status check_environment() {
  if (const std::string memory = environment(memory_variable); !memory.empty())
    if (const auto bytes = parse_bytes(memory); !bytes) return fail_in(memory_variable, bytes.error());
  if (const std::string threads = environment(threads_variable); !threads.empty())
    if (const std::string wrong = check_range(threads, 1, most_threads); !wrong.empty())
      return fail(ErrorCode::invalid_argument, "{}: {}", threads_variable, wrong);
  return {};
}

// May throw what the libraries throw.
int parse_and_run(CommandLine& app, int argc, char** argv, const std::function<Status()>& body) {
  app.parser().set_version_flag("--version", app.get_name() + " " SPLATVOL_VERSION);
  if (const std::string text = text_for_installation(app, argc, argv); !text.empty()) return print_fully(app, text);
  try {
    app.parser().parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const std::string unknown =
        unknown_option(app.parser(), std::span(argv, static_cast<std::size_t>(argc)).subspan(1));
    if (error.get_exit_code() != 0 && !unknown.empty()) {
      say(app.get_name(), unknown);
      return 2;
    }
    return app.parser().exit(error) != 0 ? 2 : print_fully(app, "");
  }

  clean_up_at_signals();
  // At a limit on file sizes, a write is to fail with an error. By default the signal would end the program.
  std::signal(SIGXFSZ, SIG_IGN);
  Status status = check_environment();
  // A program with an option for it heeds the environment there.
  if (status) status = heed_limits(app.parser().get_option_no_throw("--threads") ? 0 : default_threads());
  if (status) status = body();
  if (status && (std::fflush(stdout) != 0 || std::ferror(stdout) != 0))
    status = fail(ErrorCode::io, "cannot write to the standard output");
  return status ? 0 : fail_with(app, status.error().message);
}

}  // namespace

int run_tool(CommandLine& app, int argc, char** argv, const std::function<Status()>& body) {
  open_standard_streams();
  return_freed_memory();
  try {
    return parse_and_run(app, argc, argv, body);
  } catch (const std::bad_alloc&) {
    return fail_with(app, "not enough memory");
  } catch (const std::exception& error) {
    return fail_with(app, one_line(error.what()));
  }
}

Status check_outputs(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs, Replace replace) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i].empty() || outputs[i] == "-") continue;
    std::error_code error;
    for (const std::string& input : inputs)
      if (std::filesystem::equivalent(outputs[i], input, error))
        return fail(ErrorCode::invalid_argument, "{}: is the input, and would be overwritten", outputs[i]);
    if (std::ranges::count(outputs, outputs[i]) > 1)
      return fail(ErrorCode::invalid_argument, "{}: is two outputs", outputs[i]);
    SPLATVOL_TRY(check_replaceable(outputs[i], replace));
  }
  return {};
}

void add_force_option(CommandLine& app, Replace& replace) {
  app.add_flag(
      "--force", [&replace] { replace = Replace::any; },
      "Replace the output even if it is a file that splatvol did not export, and may be an input of yours");
}

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

ProgressBar::ProgressBar(std::string stage)
    : stage_(std::move(stage)), visible_(::isatty(STDERR_FILENO) == 1), start_(seconds_now()) {}

ProgressBar::~ProgressBar() {
  if (visible_) fmt::print(stderr, "\r\033[K");
}

void ProgressBar::update(double fraction) {
  const double now = seconds_now();
  if (!visible_ || now - last_drawn_ < 0.1) return;
  last_drawn_ = now;
  constexpr int width = 32;
  const int filled = static_cast<int>(fraction * width);
  const double left = fraction > 0 ? (now - start_) * (1 - fraction) / fraction : 0;
  fmt::print(stderr, "\r\033[K{:<10} [{:=>{}}{:>{}}] {:3.0f} %  {:.0f} s left", stage_, "", filled, "", width - filled,
             fraction * 100, left);
  std::fflush(stderr);
}

Result<std::uint64_t> parse_bytes(const std::string& text) {
  double number = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  std::string suffix(end, text.data() + text.size());
  std::ranges::transform(suffix, suffix.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  constexpr std::string_view units = "BKMGT";
  const std::size_t power = suffix.empty() ? 0 : units.find(suffix[0]);
  const std::string rest = suffix.empty() ? suffix : suffix.substr(1);
  const bool known = power < units.size() && (rest.empty() || (power > 0 && (rest == "B" || rest == "IB")));
  const double bytes = known ? number * std::pow(1024.0, static_cast<double>(power)) : -1;
  if (error != std::errc() || !(bytes >= 0) || bytes >= 0x1p63)
    return fail(ErrorCode::invalid_argument, "'{}' is not a size such as 512M or 2G", text);
  return static_cast<std::uint64_t>(bytes);
}

std::string default_memory(std::uint64_t mebibytes) {
  if (const std::string chosen = environment(memory_variable); !chosen.empty()) return chosen;
  return fmt::format("{}M", std::min<std::uint64_t>(mebibytes, memory_limit() >> 21));
}

Result<std::uint64_t> memory_or_quarter(const std::string& text) {
  const std::string chosen = text.empty() ? environment(memory_variable) : text;
  return chosen.empty() ? Result<std::uint64_t>(memory_limit() / 4) : parse_bytes(chosen);
}

unsigned default_threads() {
  return static_cast<unsigned>(std::strtoul(environment(threads_variable).c_str(), nullptr, 10));
}

std::optional<std::vector<double>> parse_numbers(std::string_view text, std::size_t count) {
  constexpr double largest_number = 1e100;  // as in a scene file
  std::vector<double> numbers;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t comma = i + 1 < count ? text.find(',') : text.size();
    if (comma == std::string_view::npos) return {};
    double number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + comma, number);
    if (error != std::errc() || end != text.data() + comma || !(std::abs(number) <= largest_number)) return {};
    numbers.push_back(number);
    text.remove_prefix(std::min(comma + 1, text.size()));
  }
  return numbers;
}

Result<std::array<int, 2>> parse_image_size(const std::string& text) {
  int width = 0;
  int height = 0;
  int end = 0;
  const bool complete = std::sscanf(text.c_str(), "%5dx%5d%n", &width, &height, &end) == 2 &&
                        static_cast<std::size_t>(end) == text.size();
  if (!complete || width < 1 || height < 1 || width > 16384 || height > 16384)
    return fail(ErrorCode::invalid_argument, "'{}' is not a size such as 640x480, with sides from 1 to 16384", text);
  return std::array{width, height};
}

std::string check_not_empty(const std::string& text) { return text.empty() ? "is empty" : ""; }

std::string check_svol_path(const std::string& text) { return check_path(text, ".svol"); }

std::string check_npy_path(const std::string& text) { return check_path(text, ".npy"); }

std::string check_json_path(const std::string& text) { return text == "-" ? "" : check_path(text, ".json"); }

std::string check_positive(const std::string& text) {
  const double number = std::strtod(text.c_str(), nullptr);
  return number > 0 && std::isfinite(number) ? "" : "'" + text + "' is not a number above 0";
}

std::string check_finite(const std::string& text) {
  return std::isfinite(std::strtod(text.c_str(), nullptr)) ? "" : "'" + text + "' is not a number";
}

}  // namespace splatvol
