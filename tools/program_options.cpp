#include "tools/program_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <set>

namespace splatvol {
namespace {

using Value = ProgramOption::Value;

// A value as CLI11 describes it: a name, then after a colon the choices, the range or a word for the check.
struct ValueType {
  std::string name;
  std::string check = {};
};

ValueType parse_type(const std::string& text) {
  for (std::size_t colon = text.find(':'); colon != std::string::npos; colon = text.find(':', colon + 1)) {
    const std::string check = text.substr(colon + 1);
    const bool is_check = check.starts_with('{') || check.find(" in [") != std::string::npos || check == "DIR" ||
                          check == "NONNEGATIVE" || check == "POSITIVE";
    if (is_check) return {text.substr(0, colon), check};
  }
  return {text};
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text)
    if (c == separator)
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

// The extensions that a text names: " .exr or .png", "OUT.vdb|OUT.vtu".
std::vector<std::string> extensions_in(const std::string& text) {
  const auto is_part = [](unsigned char c) { return std::islower(c) != 0 || std::isdigit(c) != 0; };
  std::vector<std::string> extensions;
  for (std::size_t dot = text.find('.'); dot != std::string::npos; dot = text.find('.', dot + 1)) {
    std::size_t end = dot + 1;
    while (end < text.size() && is_part(static_cast<unsigned char>(text[end]))) ++end;
    const std::string extension = text.substr(dot, end - dot);
    const bool begins_number = end > dot + 1 && std::isdigit(static_cast<unsigned char>(text[dot + 1])) != 0;
    if (extension.size() > 1 && !begins_number && std::ranges::find(extensions, extension) == extensions.end())
      extensions.push_back(extension);
  }
  // Wherever a file is taken, an index of files is.
  const auto svol = std::ranges::find(extensions, ".svol");
  if (svol != extensions.end() && text.find("URL") != std::string::npos) extensions.emplace_back(".svols");
  return extensions;
}

void set_value(const std::string& type_text, const std::string& description, ProgramOption& option) {
  const ValueType type = parse_type(type_text);
  option.value = Value::text;
  option.value_name = type.name;
  while (option.value_name.ends_with('.')) option.value_name.pop_back();
  if (type.check.starts_with('{')) {
    option.choices = split(type.check.substr(1, type.check.size() - 2), ',');
    const std::string all = fmt::format("{}", fmt::join(option.choices, "|"));
    if (all.size() <= 40)
      option.value_name = all;
    else
      option.remarks.push_back(fmt::format("One of {}.", fmt::join(option.choices, ", ")));
    return;
  }
  if (const std::size_t range = type.check.find('['); range != std::string::npos)
    option.remarks.push_back(fmt::format(
        "From {}.",
        CLI::detail::find_and_replace(type.check.substr(range + 1, type.check.size() - range - 2), " - ", " to ")));
  if (type.name == "DIR" || type.name == "FOLDER") {
    option.value = Value::folder;
    return;
  }
  const bool tells_more = type.name == "OUT" || type.name == "TEXT";
  option.extensions = extensions_in(tells_more ? description : type.name);
  if (tells_more || option.value_name == "IN" || option.value_name == "RECORDING" || !option.extensions.empty())
    option.value = Value::file;
}

// Sorted: CLI11 has them in the order of their addresses.
std::string names_of(const std::set<CLI::Option*>& options) {
  std::set<std::string> names;
  for (const CLI::Option* option : options) names.insert(option->get_name());
  return fmt::format("{}", fmt::join(names, ", "));
}

ProgramOption option_of(const CLI::Option& described) {
  ProgramOption option;
  for (const std::string& name : described.get_snames()) option.names.push_back("-" + name);
  for (const std::string& name : described.get_lnames()) option.names.push_back("--" + name);
  option.description = described.get_description();
  option.is_required = described.get_required();
  option.is_repeatable = described.get_expected_max() >= CLI::detail::expected_max_vector_size;
  if (described.get_expected_max() > 0) set_value(described.get_type_name(), option.description, option);
  if (option.names.empty() && described.get_type_name() == "TEXT") {
    option.value_name = described.get_name(true, false);
    while (option.value_name.ends_with('.')) option.value_name.pop_back();
    std::ranges::transform(option.value_name, option.value_name.begin(),
                           [](unsigned char c) { return std::toupper(c); });
  }
  if (option.value != Value::none && !described.get_default_str().empty())
    option.remarks.push_back(fmt::format("Default: {}.", described.get_default_str()));
  if (!described.get_needs().empty())
    option.remarks.push_back(fmt::format("Needs {}.", names_of(described.get_needs())));
  if (!described.get_excludes().empty())
    option.remarks.push_back(fmt::format("Not together with {}.", names_of(described.get_excludes())));
  return option;
}

}  // namespace

ProgramOptions options_of(const CLI::App& app, const std::string& name) {
  ProgramOptions program{.name = name, .description = app.get_description()};
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    (option->nonpositional() ? program.options : program.places).push_back(option_of(*option));
  }
  for (const CLI::App* subcommand : app.get_subcommands([](const CLI::App*) { return true; }))
    program.subcommands.push_back(options_of(*subcommand, subcommand->get_name()));
  return program;
}

}  // namespace splatvol
