#include <fmt/format.h>

#include <algorithm>

#include "tools/program_options.h"

namespace splatvol {
namespace {

using Value = ProgramOption::Value;

// The beginning of a description, short enough for a menu: up to a full stop, a semicolon or a colon.
std::string short_text(const std::string& description) {
  std::size_t end = description.size();
  for (const char* separator : {". ", "; ", ": ", " ("})
    if (const std::size_t found = description.find(separator); found != std::string::npos && found >= 10)
      end = std::min(end, found);
  std::string text = description.substr(0, end);
  if (text.size() > 100) text = text.substr(0, text.rfind(' ', 100)) + " ...";
  while (text.ends_with('.') && !text.ends_with(" ...")) text.pop_back();
  return text;
}

std::string with_each(const std::vector<std::string>& parts, std::string_view separator) {
  return fmt::format("{}", fmt::join(parts, separator));
}

// ---- bash

// The function of the script that sets COMPREPLY to the values of an option.
std::string bash_values(const std::string& function, const ProgramOption& option) {
  if (!option.choices.empty()) return fmt::format("{}_words '{}'", function, with_each(option.choices, " "));
  if (option.value == Value::folder) return function + "_files /";
  if (option.value == Value::file) return fmt::format("{}_files {}", function, with_each(option.extensions, " "));
  return ":";
}

std::string bash_function(const std::string& program, const std::string& name, const ProgramOptions& part) {
  std::string text = fmt::format("{}() {{\n", name);
  std::vector<std::string> words;
  std::string cases;
  for (const ProgramOption& option : part.options) {
    words.insert(words.end(), option.names.begin(), option.names.end());
    if (option.value != Value::none)
      cases += fmt::format("    {}) {}; return ;;\n", with_each(option.names, "|"), bash_values(program, option));
  }
  if (!cases.empty()) text += "  case $before in\n" + cases + "  esac\n";
  for (const ProgramOptions& subcommand : part.subcommands) words.push_back(subcommand.name);
  const std::string list = fmt::format("{}_words '{}'", program, with_each(words, " "));
  if (part.places.empty()) return text + "  " + list + "\n}\n";
  text += fmt::format("  if [[ $word == -* ]]; then\n    {}\n  else\n    {}\n  fi\n}}\n", list,
                      bash_values(program, part.places.back()));
  return text;
}

std::string bash_completion(const ProgramOptions& program) {
  const std::string name = "_" + program.name;
  std::string text = fmt::format(
      R"(# Completion for bash. Made by {0} --completion bash.
{1}_words() {{
  mapfile -t COMPREPLY < <(compgen -W "$1" -- "$word")
}}
# Files with one of these extensions, or all; and folders, to go into them.
{1}_files() {{
  compopt -o filenames 2> /dev/null
  local extension
  mapfile -t COMPREPLY < <(
    if [[ $# -eq 0 ]]; then
      compgen -f -- "$word"
    else
      compgen -d -- "$word"
      for extension; do [[ $extension == / ]] || compgen -f -X "!*$extension" -- "$word"; done
    fi
  )
}}
)",
      program.name, name);
  for (const ProgramOptions& subcommand : program.subcommands)
    text += bash_function(name, name + "_" + subcommand.name, subcommand);
  text += bash_function(name, name + "_options", program);
  text += fmt::format(R"({0}() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} part
  # --option=value is three words.
  if [[ $word == = ]]; then
    word=''
  elif [[ $before == = && $COMP_CWORD -gt 1 ]]; then
    before=${{COMP_WORDS[COMP_CWORD - 2]}}
  fi
)",
                      name);
  for (const ProgramOptions& subcommand : program.subcommands)
    text += fmt::format(
        "  for part in \"${{COMP_WORDS[@]:1:COMP_CWORD-1}}\"; do\n"
        "    [[ $part != {0} ]] || {{ {1}_{0}; return; }}\n  done\n",
        subcommand.name, name);
  return text + fmt::format("  {0}_options\n}}\ncomplete -F {0} {1}\n", name, program.name);
}

// ---- zsh

std::string zsh_text(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\'')
      result += "'\\'";
    else if (c == '[' || c == ']' || c == ':' || c == '\\')
      result += '\\';
    result += c;
  }
  return result;
}

std::string zsh_values(const ProgramOption& option) {
  if (!option.choices.empty()) return "(" + with_each(option.choices, " ") + ")";
  if (option.value == Value::folder) return "_files -/";
  if (option.value != Value::file) return " ";
  if (option.extensions.empty()) return "_files";
  std::vector<std::string> endings;
  for (const std::string& extension : option.extensions) endings.push_back(extension.substr(1));
  return "_files -g \"*.(" + with_each(endings, "|") + ")\"";
}

std::string zsh_arguments(const ProgramOptions& part) {
  std::string text = "  _arguments -s -S";
  for (const ProgramOption& option : part.options) {
    const std::string value =
        option.value == Value::none ? "" : ":" + zsh_text(option.value_name) + ":" + zsh_values(option);
    for (const std::string& name : option.names) {
      const bool is_long = name.starts_with("--");
      // A name excludes the others of its option, and itself unless it may come again.
      const std::string before = option.is_repeatable ? "*" : "(" + with_each(option.names, " ") + ")";
      text += fmt::format(" \\\n    '{}{}{}[{}]{}'", before, name,
                          value.empty() ? ""
                          : is_long     ? "="
                                        : "+",
                          zsh_text(short_text(option.description)), value);
    }
  }
  int place = 0;
  for (const ProgramOption& option : part.places)
    text += fmt::format(" \\\n    '{}:{}:{}'", option.is_repeatable ? "*" : std::to_string(++place),
                        zsh_text(option.value_name), zsh_values(option));
  return text;
}

std::string zsh_completion(const ProgramOptions& program) {
  std::string text = fmt::format("#compdef {0}\n# Completion for zsh. Made by {0} --completion zsh.\n", program.name);
  if (program.subcommands.empty()) return text + zsh_arguments(program) + "\n";
  text += fmt::format("_{}() {{\n  local state line\n", program.name);
  std::vector<std::string> names;
  for (const ProgramOptions& subcommand : program.subcommands) names.push_back(subcommand.name);
  text += zsh_arguments(program) +
          fmt::format(" \\\n    '1:subcommand:({})' '*::arguments:->arguments'\n", with_each(names, " "));
  text += "  [[ $state == arguments ]] || return 0\n  case $line[1] in\n";
  for (const ProgramOptions& subcommand : program.subcommands)
    text += fmt::format("  {})\n{}\n  ;;\n", subcommand.name, zsh_arguments(subcommand));
  return text + fmt::format("  esac\n}}\n_{} \"$@\"\n", program.name);
}

// ---- fish

std::string fish_text(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\'' || c == '\\') result += '\\';
    result += c;
  }
  return result;
}

std::string fish_values(const ProgramOption& option) {
  if (!option.choices.empty()) return " -x -a '" + with_each(option.choices, " ") + "'";
  if (option.value == Value::folder) return " -x -a '(__fish_complete_directories)'";
  if (option.value == Value::text) return " -x";
  if (option.extensions.empty()) return " -r -F";
  std::string text = " -x -k -a '(";
  for (const std::string& extension : option.extensions)
    text += (text.ends_with('(') ? "" : "; ") + ("__fish_complete_suffix " + extension);
  return text + ")'";
}

std::string fish_lines(const std::string& program, const std::string& condition, const ProgramOptions& part) {
  const std::string begin = fmt::format("complete -c {}{}", program, condition);
  std::string text;
  for (const ProgramOption& option : part.options) {
    text += begin;
    for (const std::string& name : option.names)
      text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
    if (option.value != Value::none) text += fish_values(option);
    text += fmt::format(" -d '{}'\n", fish_text(short_text(option.description)));
  }
  for (const ProgramOption& place : part.places) text += begin + fish_values(place) + "\n";
  if (part.places.empty()) text += begin + " -f\n";
  return text;
}

std::string fish_completion(const ProgramOptions& program) {
  std::string text = fmt::format("# Completion for fish. Made by {} --completion fish.\n", program.name);
  if (program.subcommands.empty()) return text + fish_lines(program.name, "", program);
  text += fish_lines(program.name, " -n __fish_use_subcommand", program);
  for (const ProgramOptions& subcommand : program.subcommands) {
    text += fmt::format("complete -c {} -n __fish_use_subcommand -f -a {} -d '{}'\n", program.name, subcommand.name,
                        fish_text(short_text(subcommand.description)));
    text += fish_lines(program.name, fmt::format(" -n '__fish_seen_subcommand_from {}'", subcommand.name), subcommand);
  }
  return text;
}

}  // namespace

std::string completion(const ProgramOptions& program, std::string_view shell) {
  if (shell == "bash") return bash_completion(program);
  if (shell == "zsh") return zsh_completion(program);
  if (shell == "fish") return fish_completion(program);
  return "";
}

}  // namespace splatvol
