// Runs the programs of this project in tests.
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>

#include "tests/support/temp_folder.h"

namespace splatvol::test {

struct Outcome {
  int code = -1;  // -1 if a signal ended the process
  std::string out, err;
  std::string text;  // of both
};

/// Runs a shell's command line in a folder. Programs of this project are found by their names. What it starts inherits
/// no handle besides the standard streams.
inline Outcome run_in(const std::string& folder, const std::string& command_line) {
  const std::unique_ptr<FILE, int (*)(FILE*)> errors(std::tmpfile(), std::fclose);
  ::fcntl(::fileno(errors.get()), F_SETFD, FD_CLOEXEC);
  FILE* pipe = ::popen(fmt::format("cd '{}' && PATH='{}':\"$PATH\" && {{ {} ; }} 2> /proc/{}/fd/{} < /dev/null", folder,
                                   SPLATVOL_BIN, command_line, ::getpid(), ::fileno(errors.get()))
                           .c_str(),
                       "r");
  Outcome outcome;
  char buffer[4096];
  while (const std::size_t got = std::fread(buffer, 1, sizeof(buffer), pipe)) outcome.out.append(buffer, got);
  // The shell tells signals as codes from 128 on.
  const int status = ::pclose(pipe);
  if (WIFEXITED(status) && WEXITSTATUS(status) < 128) outcome.code = WEXITSTATUS(status);
  std::rewind(errors.get());
  while (const std::size_t got = std::fread(buffer, 1, sizeof(buffer), errors.get())) outcome.err.append(buffer, got);
  outcome.text = outcome.out + outcome.err;
  return outcome;
}

/// A test with a folder of its own, in which it runs programs.
struct ProgramTest : FolderTest {
  [[nodiscard]] Outcome run(const std::string& command_line) const { return run_in(folder_, command_line); }

  /// Expects success without a complaint.
  void expect_done(const std::string& command_line) const {
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, 0) << command_line << ": " << outcome.text;
    EXPECT_EQ(outcome.err, "") << command_line;
  }

  /// Expects an exit code, one line that tells the program and the reason, and no new file. A wrong call, code 2, has
  /// two lines without the program.
  void expect_refusal(const std::string& command_line, const std::string& reason, int code = 1) const {
    const auto before = names();
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, code) << command_line << ": " << outcome.text;
    const std::string program = command_line.substr(0, command_line.find(' '));
    EXPECT_EQ(outcome.err.starts_with(program + ": "), code == 1) << command_line << ": " << outcome.err;
    EXPECT_THAT(outcome.err, testing::HasSubstr(reason)) << command_line;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), code) << command_line << ": " << outcome.err;
    EXPECT_EQ(outcome.out, "") << command_line;
    EXPECT_EQ(names(), before) << command_line;
  }
};

}  // namespace splatvol::test
