// Reading inputs of foreign formats: shared by the programs that do.
#pragma once

#include <string>

#include "builder/sources/process/reader_process.h"
#include "renderer/surfaces/surface.h"
#include "tools/command_line.h"

namespace splatvol {

/// Returns the path of a program that this one needs: it lies beside this one, or where it is installed.
[[nodiscard]] std::string find_program(const std::string& name);

struct ReadingOptions {
  std::string memory;  // empty: three quarters of what this process may have
  unsigned seconds = 300;
  double factor = 1;
};

void add_reading_options(CommandLine& app, ReadingOptions& options);

/// `threads`: most threads; 0: those of the machine.
[[nodiscard]] Result<ReaderProcessOptions> reader_options_of(const ReadingOptions& options, unsigned threads);

/// Fails if an input is named by an address.
[[nodiscard]] Status check_no_address(const std::vector<std::string>& inputs);

/// Names the files in folders that hold data but are left out (builder/opening/input_files.h), in a line; empty if
/// there are none.
[[nodiscard]] std::string describe_left_out(const std::vector<std::string>& inputs);

/// Prints a warning with describe_left_out(), if there are such files.
void warn_of_left_out(const std::vector<std::string>& inputs);

/// Returns a reader of files of surfaces, which reads them in a process of its own. That process ends with the reader.
/// Prints a warning if a file may be cut off.
[[nodiscard]] ReadSurface surface_reader(const ReaderProcessOptions& options);

}  // namespace splatvol
