// The system calls that a reader process may make.
#pragma once

#include <fcntl.h>

namespace splatvol {

/// An open with these flags goes to the kernel at once. No library has a reason to name both.
inline constexpr int unasked_open_flags = O_NONBLOCK | O_NOCTTY;

/// Lets all threads of this process, now and later, make only the system calls that reading files takes. The others
/// fail. Files can be opened for reading only, and not locked; opens without all of unasked_open_flags are answered by
/// answer_opens(), which must have been called (opened_files.h). `limits_memory`: no memory passes RLIMIT_DATA, and
/// RLIMIT_STACK no longer changes. Requires no_new_privs. Does nothing where the kernel has no seccomp. Call it in the
/// main thread.
void allow_reading_only(bool limits_memory);

}  // namespace splatvol
