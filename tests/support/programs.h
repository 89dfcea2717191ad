// Runs the programs of this project in tests.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include "tests/support/temp_folder.h"

namespace splatvol::test {

struct Outcome {
  int code;          // -1 if a signal ended the process
  std::string text;  // of stdout and stderr
};

/// Runs a shell's command line in a folder.
inline Outcome run_in(const std::filesystem::path& folder, const std::string& command_line) {
  const std::string command = fmt::format("cd '{}' && {{ {} ; }} 2>&1 < /dev/null", folder.string(), command_line);
  Outcome outcome{-1, ""};
  FILE* pipe = ::popen(command.c_str(), "r");
  if (!pipe) return outcome;
  char buffer[4096];
  while (const std::size_t got = std::fread(buffer, 1, sizeof(buffer), pipe)) outcome.text.append(buffer, got);
  const int status = ::pclose(pipe);
  if (WIFEXITED(status)) outcome.code = WEXITSTATUS(status);
  return outcome;
}

/// A test with a folder of its own, in which it runs programs.
class ProgramTest : public FolderTest {
 protected:
  /// `command_line`: a program of this project and its arguments.
  [[nodiscard]] Outcome run(const std::string& command_line) const {
    return run_in(folder_, fmt::format("'{}'/{}", SPLATVOL_BIN, command_line));
  }
  void expect_done(const std::string& command_line) const {
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, 0) << command_line << ": " << outcome.text;
  }
  void expect_refusal(const std::string& command_line, const std::string& reason, int code = 1) const {
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, code) << command_line << ": " << outcome.text;
    EXPECT_THAT(outcome.text, testing::HasSubstr(reason)) << command_line;
  }
};

}  // namespace splatvol::test
