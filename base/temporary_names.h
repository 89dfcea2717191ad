// The names of temporary files, for programs that a signal ends.
#pragma once

#include <string>

namespace splatvol {

/// Returns a name that no file has, in the folder of `path`, however long the name of `path` is.
[[nodiscard]] std::string temporary_name_beside(const std::string& path);

/// Notes a temporary file, or a folder of files, until forget_temporary(). Thread-safe.
void note_temporary(const std::string& path);
void forget_temporary(const std::string& path);
[[nodiscard]] bool is_noted_temporary(const std::string& path);

/// Removes the files and folders that are noted. Safe in a signal handler.
void remove_temporaries();

}  // namespace splatvol
