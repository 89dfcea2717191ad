// The options of a program: CLI11, whose templates take seconds to compile in each source that sees them. Only
// command_line.cpp, tool.cpp and program_options.cpp do.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace splatvol {

/// Returns why it refuses the text of a value; empty: it accepts.
using OptionCheck = std::function<std::string(const std::string&)>;

/// Makes the check of a text that parse(text) can read. Parse returns a Result.
template <class Parse>
OptionCheck check_of(Parse parse) {
  return [parse](const std::string& text) {
    const auto parsed = parse(text);
    return parsed ? std::string() : parsed.error().message;
  };
}

/// An option of a command line. Its functions return the option itself, so that calls follow each other.
class CommandOption {
 public:
  explicit CommandOption(CLI::Option& option) : option_(option) {}

  CommandOption* required(bool is_required = true);
  /// What stands for the value in --help.
  CommandOption* type_name(const std::string& name);
  /// `values`: what --help says of the values that pass.
  CommandOption* check(OptionCheck check, const std::string& values = "");
  /// Takes numbers from `low` to `high`; T: int, unsigned, std::uint64_t or double.
  template <class T>
  CommandOption* range(T low, T high);
  CommandOption* not_negative();
  CommandOption* one_of(std::vector<std::string> values);
  CommandOption* existing_folder();
  CommandOption* excludes(CommandOption* other);
  CommandOption* needs(CommandOption* other);
  /// Shows the value of the variable as the default.
  CommandOption* capture_default_str();
  CommandOption* default_str(const std::string& text);
  /// Several values stand in one argument, with this character between them.
  CommandOption* delimiter(char character);
  /// So many values.
  CommandOption* expected(int count);
  /// Whether several values may follow the option; else it is given once for each.
  CommandOption* allow_extra_args(bool allowed);
  /// The heading in --help.
  CommandOption* group(const std::string& heading);

  /// Whether the command line has it.
  [[nodiscard]] bool is_given() const;

 private:
  CLI::Option& option_;
};

/// The command line of a program, or of one of its subcommands. run_tool (tool.h) parses it.
class CommandLine {
 public:
  CommandLine(const std::string& description, const std::string& name);

  /// Parsing writes the value into `target`. T: std::string, a number, a vector of these, or an optional one.
  template <class T>
  CommandOption* add_option(const std::string& names, T& target, const std::string& description);
  CommandOption* add_flag(const std::string& names, bool& target, const std::string& description);
  /// Calls `given` if the flag is there.
  CommandOption* add_flag(const std::string& names, std::function<void()> given, const std::string& description);
  /// The option of a name, which has been added.
  [[nodiscard]] CommandOption* get_option(const std::string& name);

  CommandLine* add_subcommand(const std::string& name, const std::string& description);
  void require_subcommand();
  /// Of a subcommand: whether the command line has it.
  [[nodiscard]] bool is_given() const;

  [[nodiscard]] std::string get_name() const;
  void description(const std::string& text);
  /// Calls `check` after parsing. It may call missing_option and wrong_option.
  void callback(std::function<void()> check);

  [[nodiscard]] CLI::App& parser() { return *app_; }

 private:
  explicit CommandLine(std::shared_ptr<CLI::App> app) : app_(std::move(app)) {}
  CommandOption* keep(CLI::Option* option) { return &options_.emplace_back(*option); }

  std::shared_ptr<CLI::App> app_;
  std::deque<CommandOption> options_;
  std::deque<CommandLine> subcommands_;
};

/// End the parsing with the usual line of a wrong command line.
[[noreturn]] void missing_option(const std::string& name);
[[noreturn]] void wrong_option(const std::string& name, const std::string& reason);

/// Returns why a text is not a whole number from `low` to `high`; empty: it is one.
[[nodiscard]] std::string check_range(const std::string& text, int low, int high);

}  // namespace splatvol
