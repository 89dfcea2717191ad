#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "tools/program_options.h"

namespace splatvol {
namespace {

// Text of a man page: a minus stays one, and no line begins with a dot or a quote by chance.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\\')
      result += "\\e";
    else if (c == '-')
      result += "\\-";
    else
      result += c;
  }
  return result.starts_with('.') || result.starts_with('\'') ? "\\&" + result : result;
}

std::string bold(const std::string& text) { return "\\fB" + escaped(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + escaped(text) + "\\fR"; }

std::string with_full_stop(std::string text) {
  while (text.ends_with('\n') || text.ends_with(' ')) text.pop_back();
  return text.empty() || text.ends_with('.') ? text : text + ".";
}

std::string first_sentence(const std::string& text) { return text.substr(0, std::min(text.find(". "), text.size())); }

std::string paragraph(std::string text) {
  text = with_full_stop(text);
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return escaped(text) + "\n";
}

// What one line of a list of programs says: "draws a file".
std::string short_description(const ProgramOptions& program) {
  std::string text = first_sentence(program.description);
  while (text.ends_with('.') || text.ends_with('\n')) text.pop_back();
  if (!text.empty()) text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return text;
}

std::string place_name(const ProgramOption& place) {
  const std::string name = italic(place.value_name) + (place.is_repeatable ? " ..." : "");
  return place.is_required ? name : "[" + name + "]";
}

std::string synopsis(const std::string& words, const ProgramOptions& program) {
  std::string line = bold(words) + " [" + italic("options") + "]";
  for (const ProgramOption& option : program.options)
    if (option.is_required) line += " " + bold(option.names.front()) + " " + italic(option.value_name);
  for (const ProgramOption& place : program.places) line += " " + place_name(place);
  return line + "\n";
}

std::string entry(const ProgramOption& option) {
  std::string heading;
  for (const std::string& name : option.names) heading += (heading.empty() ? "" : ", ") + bold(name);
  if (option.value != ProgramOption::Value::none)
    heading += (heading.empty() ? "" : " ") + italic(option.value_name) + (option.is_repeatable ? " ..." : "");
  std::string text = with_full_stop(option.description);
  for (const std::string& remark : option.remarks) text += " " + remark;
  return ".TP\n" + heading + "\n" + paragraph(text);
}

std::string entries(const ProgramOptions& program) {
  std::string text;
  for (const ProgramOption& place : program.places) text += entry(place);
  for (const ProgramOption& option : program.options) text += entry(option);
  return text;
}

}  // namespace

std::string man_page(const ProgramOptions& program, const std::string& version) {
  std::string upper = program.name;
  std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return std::toupper(c); });
  std::string page = fmt::format(".TH {} 1 \"\" \"splatvol {}\" \"splatvol\"\n", escaped(upper), version);
  page +=
      fmt::format(".SH NAME\n{} \\- {}\n.SH SYNOPSIS\n", escaped(program.name), escaped(short_description(program)));
  if (program.subcommands.empty()) page += synopsis(program.name, program);
  for (const ProgramOptions& subcommand : program.subcommands)
    page += (&subcommand == program.subcommands.data() ? "" : ".br\n") +
            synopsis(program.name + " " + subcommand.name, subcommand);
  page += ".SH DESCRIPTION\n" + paragraph(program.description) + ".SH OPTIONS\n" + entries(program);
  for (const ProgramOptions& subcommand : program.subcommands)
    page += ".SS " + bold(program.name + " " + subcommand.name) + "\n" + paragraph(subcommand.description) +
            entries(subcommand);
  page +=
      ".SH EXIT STATUS\n0 when done; 1 and one line on the standard error when a file or its data is bad; 2 when "
      "called wrongly.\n.SH SEE ALSO\n";
  std::string others;
  for (const std::string name :
       {"svbuild", "svdiff", "svexport", "svgen", "svinfo", "svrender", "svserve", "svtruth", "svview"})
    if (name != program.name) others += (others.empty() ? ".BR " : " ,\n.BR ") + name + " (1)";
  return page + others + "\n";
}

}  // namespace splatvol
