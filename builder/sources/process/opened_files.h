// Which files a reader process may open.
#pragma once

#include <string>

namespace splatvol {

/// Answers the opens that the kernel hands over to this process by SIGSYS (allow_reading_only): regular files and
/// folders are opened. Pipes, devices and sockets are not: opening a pipe, or reading it, may take for ever, and
/// opening a device may do something.
void answer_opens();

/// Returns a file that was refused since the last call, or an empty text.
[[nodiscard]] std::string take_refused_file();

}  // namespace splatvol
