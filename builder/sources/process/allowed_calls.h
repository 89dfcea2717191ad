// The system calls that a reader process may make.
#pragma once

namespace splatvol {

/// Lets all threads of this process, now and later, make only the system calls that reading files takes. The others
/// fail. Files can be opened for reading only; an open without O_NONBLOCK is answered by answer_opens(), which must
/// have been called (opened_files.h). Requires no_new_privs. Does nothing where the kernel has no seccomp.
void allow_reading_only();

}  // namespace splatvol
