// script_options SCRIPT (--help-man | --completion SHELL): man page and completions of a program that is a script, from
// the text of its --help. Only the build runs it. The text: "NAME: DESCRIPTION", "Usage: ...", then a line for each
// option, "  --option VALUE  description" or "  VALUE  description".
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>

#include "tools/tool.h"

namespace splatvol {
namespace {

std::string output_of(const std::string& command) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(::popen(command.c_str(), "r"), ::pclose);
  std::string text;
  for (int c = 0; pipe && (c = std::fgetc(pipe.get())) != EOF;) text += static_cast<char>(c);
  return text;
}

void add_option(CommandLine& app, const std::string& line, std::string& value) {
  const std::size_t end = line.find("  ", 2), description = line.find_first_not_of(' ', end);
  const std::string names = line.substr(2, end - 2);
  const std::size_t space = names.find(' ');
  if (names.starts_with('-') && space == std::string::npos) {
    const std::string what = line.substr(description);
    app.add_flag(
        names, [] {}, what);
    return;
  }
  auto* option = app.add_option(names.substr(0, space), value, line.substr(description));
  option->type_name(space == std::string::npos ? names : names.substr(space + 1));
  option->required(!names.starts_with('-'));
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  splatvol::CommandLine app("", std::filesystem::path(argv[1]).filename());
  std::istringstream usage(splatvol::output_of(std::string("'") + argv[1] + "' --help"));
  std::string value;
  for (std::string line; std::getline(usage, line);) {
    const std::string begin = app.get_name() + ": ";
    if (line.starts_with(begin)) app.description(line.substr(begin.size()));
    if (line.starts_with("  ") && line.find("  ", 2) != std::string::npos) splatvol::add_option(app, line, value);
  }
  return splatvol::run_tool(app, argc - 1, argv + 1, [] { return splatvol::Status(); });
}
