// The options of a program as data. Man pages and completions of shells are made of them, so they are never out of
// date.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace splatvol {

struct ProgramOption {
  enum class Value { none, text, file, folder };

  std::vector<std::string> names;            // with their dashes; empty: given by its place
  Value value = Value::none;                 // none: a flag
  std::string value_name;                    // such as FILE.svol|URL
  std::vector<std::string> choices = {};     // the only values, if there are any
  std::vector<std::string> extensions = {};  // of files, such as .svol; empty: any file
  bool is_required = false;
  bool is_repeatable = false;
  std::string description;
  std::vector<std::string> remarks = {};  // sentences: range, default, options that it needs or excludes
};

struct ProgramOptions {
  std::string name;
  std::string description;
  std::vector<ProgramOption> places = {};   // options without a name, in their order
  std::vector<ProgramOption> options = {};  // in the order of --help
  std::vector<ProgramOptions> subcommands = {};
};

/// Returns the options that `app` lists in its help. `name` replaces the name of `app`.
[[nodiscard]] ProgramOptions options_of(const CLI::App& app, const std::string& name);

/// Returns a man page in section 1, in roff with the macros of man(7).
[[nodiscard]] std::string man_page(const ProgramOptions& program, const std::string& version);

/// Returns a script that completes the options of a program and their values. `shell`: bash, zsh or fish; of any other
/// the text is empty.
[[nodiscard]] std::string completion(const ProgramOptions& program, std::string_view shell);

}  // namespace splatvol
