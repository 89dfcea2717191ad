// Which files a reader process may open, and which it has opened.
#pragma once

#include <string>
#include <vector>

namespace splatvol {

/// Answers the opens that the kernel hands over to this process by SIGSYS (allow_reading_only): regular files and
/// folders are opened. Pipes, devices and sockets are not: opening a pipe, or reading it, may take for ever, and
/// opening a device may do something. All are noted, whichever library opens them.
void answer_opens();

/// The files and folders that this process has opened since the last call, and those that were not there. Paths are as
/// they were given, or absolute. A name may come twice.
struct OpenedFiles {
  std::vector<std::string> opened, missing;
  bool are_all = true;  // false: memory did not suffice for all names
};
[[nodiscard]] OpenedFiles take_opened_files();

/// Returns a file that was refused since the last call, or an empty text.
[[nodiscard]] std::string take_refused_file();

}  // namespace splatvol
