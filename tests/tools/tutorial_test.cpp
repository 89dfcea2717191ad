// The commands of docs/tutorial.md, with OpenFOAM's: they work, and print what stands below them.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "base/file.h"
#include "tests/support/long.h"
#include "tests/support/programs.h"

namespace splatvol::test {
namespace {

struct Step {
  std::string commands;
  std::vector<std::string> output;  // some of its lines, in their order
};

// Returns the blocks of shell commands, each with the block of text below it.
std::vector<Step> tutorial() {
  std::istringstream page(read_text_file(SPLATVOL_DOCS "/tutorial.md").value());
  std::vector<Step> steps;
  std::string block;
  for (std::string line; std::getline(page, line);) {
    if (line.starts_with("```")) {
      block = block.empty() ? line.substr(3) : "";
      if (block == "sh") steps.emplace_back();
    } else if (block == "sh") {
      steps.back().commands += (steps.back().commands.empty() ? "" : "\n") + line;
    } else if (block == "text" && !line.empty()) {
      steps.back().output.push_back(line);
    }
  }
  return steps;
}

bool has(const std::string& text, const std::string& word) { return text.find(word) != std::string::npos; }

using Tutorial = ProgramTest;

TEST_F(Tutorial, PrintsWhatThePageSays) {
  if (!is_long()) GTEST_SKIP() << "takes minutes: the label long";
  if (run("command -v blockMesh && command -v ffmpeg").code != 0) GTEST_SKIP() << "needs OpenFOAM and ffmpeg";
  std::filesystem::create_directory_symlink(SPLATVOL_DOCS, path("docs"));
  const std::vector<Step> steps = tutorial();
  ASSERT_GT(steps.size(), 8u) << "the page has another form now";
  for (const Step& step : steps) {
    // Packages, a window, and a server for another terminal.
    if (has(step.commands, "apt-get") || has(step.commands, "svview") || has(step.commands, "127.0.0.1")) continue;
    const Outcome outcome = run("export WM_PROJECT_DIR=/usr/share/openfoam; " + step.commands);
    ASSERT_EQ(outcome.code, 0) << step.commands << "\n" << outcome.text;
    std::istringstream lines(std::regex_replace(outcome.text, std::regex(", [0-9.]+ s\n| +\n"), "\n"));
    for (const std::string& expected : step.output) {
      bool found = false;
      for (std::string line; !found && std::getline(lines, line);) found = line == expected;
      EXPECT_TRUE(found) << step.commands << "\ndoes not print, or not in this order:\n"
                         << expected << "\n"
                         << outcome.text;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
