// Other programs.
#pragma once

#include <string>
#include <vector>

namespace splatvol {

/// The exit code of a program that is not there.
inline constexpr int no_program = 127;

/// Files that a program reads as its input, and writes its words to.
struct ProgramFiles {
  std::string input = "/dev/null";
  std::string log = "/dev/null";
};

/// Runs a program that PATH finds, without a shell, and waits for its end. `words`: its name and its arguments. Returns
/// its exit code; `no_program` if there is none, 126 if a signal ended it.
[[nodiscard]] int run_program(const std::vector<std::string>& words, const ProgramFiles& files = {});

}  // namespace splatvol
